"""Meshes on the GPU: triangles stay there, vertices are uploaded for each frame."""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.core.mesh import SKIN_ALBEDO, Mesh
from glsim.gl.draw import index_buffer
from glsim.gl.program import MeshPrograms

#: Number of triangle lists kept on the GPU: of sources, clothes, furniture, and files of a folder.
CACHED_TOPOLOGIES = 32


@dataclass(eq=False)
class GpuMesh:
    """A mesh in GPU buffers.

    Attributes:
        faces, occluder: triangle arrays of the mesh, kept alive because their ids are cache keys.
        positions: (V, 3) float32, canonical mm.
        albedos: (V,) float32.
        sheet: the attributes of strands, as in ``Context.vertex_array``; empty without strands.
        surface, projector: vertex arrays for the camera and for the emitters.
        vertices_mm, albedo: the arrays of the last upload. The same object is not uploaded again,
            because arrays of a mesh are never changed in place.
    """

    faces: NDArray[np.int32]
    occluder: NDArray[np.int32] | None
    positions: moderngl.Buffer
    albedos: moderngl.Buffer
    surface: moderngl.VertexArray
    projector: moderngl.VertexArray
    sheet: list[tuple[moderngl.Buffer, str, str, str]]
    vertices_mm: object = field(default_factory=object)
    albedo: object = field(default_factory=object)


class MeshCache:
    """A cache of meshes on the GPU, which keeps the buffers of the last used triangle lists."""

    def __init__(
        self, context: moderngl.Context, surface: MeshPrograms, projector: MeshPrograms
    ) -> None:
        self._context, self._surface, self._projector = context, surface, projector
        self._meshes: OrderedDict[tuple[int, int], GpuMesh] = OrderedDict()

    def upload(self, mesh: Mesh) -> GpuMesh:
        """Upload the vertices of a mesh, and its triangles if they are new."""
        key = id(mesh.faces), id(mesh.occluder)
        uploaded = self._meshes.get(key)
        if uploaded is None or uploaded.positions.size != mesh.vertices_mm.nbytes:
            uploaded = self._upload_topology(mesh)
            self._meshes[key] = uploaded
            if len(self._meshes) > CACHED_TOPOLOGIES:
                self._meshes.popitem(last=False)
        self._meshes.move_to_end(key)
        if uploaded.vertices_mm is not mesh.vertices_mm:
            uploaded.positions.write(np.ascontiguousarray(mesh.vertices_mm, dtype=np.float32))
            uploaded.vertices_mm = mesh.vertices_mm
        if uploaded.albedo is not mesh.albedo:
            skin = np.full(len(mesh.vertices_mm), SKIN_ALBEDO, np.float32)
            uploaded.albedos.write(skin if mesh.albedo is None else mesh.albedo)
            uploaded.albedo = mesh.albedo
        return uploaded

    def _upload_topology(self, mesh: Mesh) -> GpuMesh:
        make = self._context.buffer
        positions = make(reserve=mesh.vertices_mm.nbytes, dynamic=True)
        albedos = make(reserve=4 * len(mesh.vertices_mm))
        indices, index_size = index_buffer(self._context, mesh.faces, len(mesh.vertices_mm))
        position = (positions, "3f", "in_position_mm")
        sheet = []
        if mesh.strands is not None:
            sheet = [(make(np.ascontiguousarray(mesh.strands)), "4f 1f", "in_strand", "in_sink_mm")]
        seen, program = sheet, self._surface[bool(sheet)]
        if mesh.folds is not None:
            folds = make(np.ascontiguousarray(mesh.folds))
            seen, program = [(folds, "4f 4f", "in_fold", "in_crease")], self._surface.folds
        content = [position, (albedos, "1f", "in_albedo"), *seen]
        surface = self._context.vertex_array(program, content, indices, index_size)
        if mesh.occluder is not None:
            indices, index_size = index_buffer(self._context, mesh.occluder, len(mesh.vertices_mm))
        projector = self._context.vertex_array(
            self._projector[bool(sheet)], [position, *sheet], indices, index_size
        )
        surface.extra = projector.extra = mesh.two_sided
        return GpuMesh(mesh.faces, mesh.occluder, positions, albedos, surface, projector, sheet)
