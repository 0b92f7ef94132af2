"""The export formats of ``glsim export``: each ``Export`` in this folder's files."""
