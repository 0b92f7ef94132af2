"""The sources of faces, one file each. The name of a file is the kind, with "_" for "-".

A file holds a table derived from ``FaceSettings``: the settings of the kind, its help, the test
that recognises its folders, and ``open``. The tables are loaded with the settings; ``open`` imports
what reads or computes geometry.
"""
