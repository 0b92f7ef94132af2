"""Data sets on disk: generate, resume, verify, read, import and export them.

Start at ``driver`` (write) or ``reader`` (read).
"""
