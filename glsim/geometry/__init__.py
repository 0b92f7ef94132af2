"""Meshes, poses, cameras, image windows and depth maps as geometry: NumPy only, no OpenGL."""
