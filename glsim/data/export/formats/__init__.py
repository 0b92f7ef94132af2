"""The formats of ``glsim export``: every ``Export`` in the files of this folder."""
