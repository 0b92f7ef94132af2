"""Render meshes for a sensor rig: clean layers, shadows, silhouettes, face regions."""
