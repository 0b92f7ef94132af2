"""The face sources, one file each: the file's name is the source's kind, with "_" for "-".

A file holds a table derived from ``FaceSettings``: the settings of the kind, its help, the test
that recognises its folders, and ``open``. Readers of data sets stand beside their table; ``open``
imports the packages of generators.
"""
