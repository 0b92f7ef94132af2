"""Types and functions that all rooms share: meshes, poses, cameras, depth frames, errors, files.

No OpenGL; of the packages NumPy and, where files are read, OpenCV.
"""
