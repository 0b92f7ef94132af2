"""Recordings of depth cameras on disk, in all formats, for all commands.

``recording`` finds the frames in a folder and reads them, ``files`` reads one frame, ``names``
tells depth maps from other images, ``board_corners`` reads the corners of chessboards;
``import_kinect2`` and ``import_biwi`` write data sets of glsim.
"""
