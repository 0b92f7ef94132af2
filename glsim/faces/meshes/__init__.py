"""Mesh files: reading OBJ, PLY, STL, GLB and OFF, and aligning them with the canonical frame."""

from glsim.faces.meshes.load import LoadedMesh, load_mesh

__all__ = ["LoadedMesh", "load_mesh"]
