"""The layer of face regions, drawn as the camera sees them: one more pass, for who asks for it."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from dataclasses import dataclass

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.camera import SensorRig
from glsim.frame import Rect
from glsim.gl.meshes import draw_meshes, index_buffer
from glsim.gl.program import link_files
from glsim.gl.source import Layer
from glsim.gl.targets import Target, TargetPool, set_matrix

REGION = Layer("region", "float")

#: Arrays kept on the GPU: as many as the renderer keeps topologies.
_CACHED = 4


@dataclass(frozen=True, eq=False)
class Labelled:
    """A mesh with labels. positions: its vertices on the GPU. labels: (V,) numbers, None is 0."""

    faces: NDArray[np.int32]
    positions: moderngl.Buffer
    labels: NDArray[np.float32] | None


class RegionPass:
    """Draws the labels of meshes on the grid of a rig's image."""

    def __init__(
        self,
        context: moderngl.Context,
        rig: SensorRig,
        pools: tuple[TargetPool, TargetPool],
        rays: Target,
    ) -> None:
        """pools: of the pinhole camera and of the image, the same one where no lens distorts."""
        self._context, self._rays = context, rays
        self._camera_pool, self._pool = pools
        self._pinhole = pinhole = rig.pinhole()
        self._program = link_files(context, "render/regions.vert", "render/regions.frag")
        set_matrix(self._program, "u_clip", pinhole.clip_matrix(rig.near_m, rig.far_m))
        self._depth = context.depth_renderbuffer((pinhole.width, pinhole.height))
        self._buffers: dict[int, moderngl.Framebuffer] = {}
        self._arrays: OrderedDict[tuple[int, int], tuple[Labelled, moderngl.VertexArray]]
        self._arrays = OrderedDict()
        self._lens: moderngl.VertexArray | None = None
        if rig.is_raw:
            lens = link_files(context, "render/fullscreen.vert", "render/lens_regions.frag")
            lens["u_pinhole"] = (pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy)
            lens["u_pinhole_region"], lens["u_rays"] = 0, 1
            self._lens = context.vertex_array(lens, [])

    def draw(
        self, meshes: Sequence[Labelled], views: Sequence[NDArray[np.float32]], window: Rect
    ) -> Target:
        """The layer REGION of a window, of the image's pool: 0 is none."""
        whole = Rect(0, 0, self._pinhole.width, self._pinhole.height)
        area = window if self._lens is None else whole
        target = self._camera_pool.take(REGION, area)
        key = target.texture.glo
        if key not in self._buffers:
            self._buffers[key] = self._context.framebuffer([target.texture], self._depth)
        buffer = self._buffers[key]
        buffer.use()
        buffer.viewport, buffer.scissor = whole, area
        buffer.clear(viewport=area)
        draw_meshes(self._context, [self._array(mesh) for mesh in meshes], self._program, views)
        if self._lens is None:
            return target
        distorted = self._pool.take(REGION, window)
        lens_buffer = self._pool.framebuffer([distorted])
        lens_buffer.use()
        lens_buffer.viewport = window
        target.texture.use(0)
        self._rays.texture.use(1)
        self._lens.render(moderngl.TRIANGLES, vertices=3)
        self._camera_pool.give_back(target)
        return distorted

    def _array(self, mesh: Labelled) -> moderngl.VertexArray:
        key = mesh.positions.glo, id(mesh.labels)
        if key not in self._arrays or self._arrays[key][0].faces is not mesh.faces:
            self._arrays[key] = mesh, self._upload(mesh)  # the mesh too: its ids stay taken
            if len(self._arrays) > _CACHED:
                self._arrays.popitem(last=False)
        self._arrays.move_to_end(key)
        return self._arrays[key][1]

    def _upload(self, mesh: Labelled) -> moderngl.VertexArray:
        count = mesh.positions.size // 12  # three float32 a vertex
        labels = np.zeros(count, np.float32) if mesh.labels is None else mesh.labels
        indices, size = index_buffer(self._context, majority_last(mesh.faces, labels), count)
        position = (mesh.positions, "3f", "in_position_mm")
        label = (self._context.buffer(labels), "1f", "in_region")
        return self._context.vertex_array(self._program, [position, label], indices, size)


def majority_last(faces: NDArray[np.int32], labels: NDArray[np.float32]) -> NDArray[np.int32]:
    """(F, 3) the same triangles, turned so that the label of the last corner is that of most.

    Where all three differ it is the lowest number: independent of the order of the corners.
    """
    corner = labels[faces]
    like = (corner[:, :, None] == corner[:, None, :]).sum(axis=2)
    best = np.lexsort((corner, -like))[:, 0]
    order = (best[:, None] + np.array([1, 2, 3])) % 3
    turned: NDArray[np.int32] = np.take_along_axis(faces, order, axis=1)
    return turned
