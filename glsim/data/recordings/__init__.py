"""Recordings of depth cameras on disk, in all formats, for all commands.

``recording`` finds the frames and reads them, ``folders`` knows what lies in a folder, ``files``
reads one frame of a file, ``streams``, ``bag`` and ``mkv`` the files that hold many,
``camera_file`` what states the camera. ``names`` tells depth maps from other images,
``opencv_yaml`` reads calibrations and corners of chessboards; ``imports`` writes data sets.
"""
