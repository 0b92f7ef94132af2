"""Checks of sensors: every function decorated with ``validation_check`` in these files."""
