"""Readers of face sets on disk: D3DFACS, FaceWarehouse, Biwi, and any folder of meshes."""
