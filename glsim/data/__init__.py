"""Data sets on disk: generation, resumption, verification, reading, import and export.

Start at ``driver`` (write) or ``reader`` (read).
"""
