"""Types and functions that all rooms share: meshes, poses, cameras, depth frames, errors, files.

It uses no OpenGL. It needs NumPy and, to read files, OpenCV.
"""
