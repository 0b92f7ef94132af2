"""Recordings of depth cameras on disk, in all formats, for all commands.

``folders`` finds depth maps and stated cameras in a folder, ``files`` reads files with one map,
``streams``, ``bag`` and ``mkv`` read files with many. ``camera_file`` reads camera.toml, ``names``
distinguishes depth maps from other images by name, ``opencv_yaml`` reads calibrations and corners
of chessboards, and ``imports`` writes data sets.
"""
