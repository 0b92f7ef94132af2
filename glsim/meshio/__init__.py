"""Mesh files: reading OBJ, PLY, STL, GLB and OFF, and aligning them with the canonical frame."""

from glsim.meshio.load import LoadedMesh, load_mesh

__all__ = ["LoadedMesh", "load_mesh"]
