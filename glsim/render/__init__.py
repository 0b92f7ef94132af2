"""Render meshes for a sensor: clean layers, shadows, silhouettes, regions."""
