"""Data sets on disk. Start at ``driver`` (write) or ``reader`` (read)."""
