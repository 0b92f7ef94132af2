"""Draw the layer of face regions in the camera's view, in an additional pass."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import SensorRig
from glsim.core.rect import Rect
from glsim.gl.declarations import Layer
from glsim.gl.draw import FullscreenPass, draw_meshes, index_buffer
from glsim.gl.program import link_files, link_meshes
from glsim.gl.targets import Target, TargetPool
from glsim.render.mesh_cache import CACHED_TOPOLOGIES, GpuMesh

REGION = Layer("region", "float")
Labels = NDArray[np.float32] | None


class RegionPass:
    """A pass that draws the region numbers of meshes in the image of a rig."""

    def __init__(
        self, context: moderngl.Context, rig: SensorRig, pools: tuple[TargetPool, TargetPool],
        rays: Target,
    ) -> None:  # fmt: skip
        """Link the program and allocate the buffers.

        ``pools``: of the pinhole and the delivered image, equal without distortion; ``rays`` holds
        ``rig.rays()``.
        """
        self._context, self._rays = context, rays
        self._camera_pool, self._pool = pools
        self._pinhole = pinhole = rig.pinhole()
        self._programs = link_meshes(context, "render/regions.frag", "render/regions.vert")
        self._programs.set_matrix("u_clip", pinhole.clip_matrix(rig.near_m, rig.far_m))
        self._depth = context.depth_renderbuffer((pinhole.width, pinhole.height))
        self._arrays: OrderedDict[tuple[int, int], tuple[object, moderngl.VertexArray]]
        self._arrays = OrderedDict()
        self._lens_pass: FullscreenPass | None = None
        if rig.keeps_distortion:
            lens = link_files(context, "render/lens_regions.frag")
            lens["u_pinhole"] = (pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy)
            self._lens_pass = FullscreenPass(context, lens)

    def draw(
        self, meshes: Sequence[GpuMesh], labels: Sequence[Labels],
        views: Sequence[NDArray[np.float32]], window: Rect,
    ) -> Target:  # fmt: skip
        """Draw the layer REGION of a window (0 = no region); return its target.

        ``labels``: for each mesh the (V,) region numbers of its vertices; None: all 0.
        """
        whole = Rect(0, 0, self._pinhole.width, self._pinhole.height)
        area = window if self._lens_pass is None else whole
        target = self._camera_pool.take(REGION, area)
        buffer = self._camera_pool.framebuffer([target], self._depth)
        buffer.use()
        buffer.viewport, buffer.scissor = whole, area
        buffer.clear(viewport=area)
        arrays = list(map(self._array, meshes, labels))
        draw_meshes(self._context, arrays, views)
        if self._lens_pass is None:
            return target
        distorted = self._pool.take(REGION, window)
        lens_buffer = self._pool.framebuffer([distorted])
        self._lens_pass.draw(lens_buffer, window, pinhole_region=target, rays=self._rays)
        self._camera_pool.give_back(target)
        return distorted

    def _array(self, mesh: GpuMesh, labels: Labels) -> moderngl.VertexArray:
        key = id(mesh.positions), id(labels)
        if key not in self._arrays:
            count = mesh.positions.size // 12  # three float32 per vertex
            numbers = np.zeros(count, np.float32) if labels is None else labels
            indices, size = index_buffer(self._context, majority_last(mesh.faces, numbers), count)
            position = (mesh.positions, "3f", "in_position_mm")
            label = (self._context.buffer(numbers), "1f", "in_region")
            program = self._programs[bool(mesh.sheet)]
            content = [position, label, *mesh.sheet]
            array = self._context.vertex_array(program, content, indices, size)
            array.extra = mesh.surface.extra
            self._arrays[key] = (mesh.positions, labels), array  # alive, so ids stay
            if len(self._arrays) > CACHED_TOPOLOGIES:
                self._arrays.popitem(last=False)
        self._arrays.move_to_end(key)
        return self._arrays[key][1]


def majority_last(faces: NDArray[np.int32], labels: NDArray[np.float32]) -> NDArray[np.int32]:
    """Rotate the corners of (F, 3) triangles so that the last corner has the majority label.

    Labels are (V,). If all three labels differ, the corner with the lowest label comes last.
    """
    corner = labels[faces]
    votes = (corner[:, :, None] == corner[:, None, :]).sum(axis=2)
    best = np.lexsort((corner, -votes))[:, 0]
    order = (best[:, None] + np.array([1, 2, 3])) % 3
    return np.asarray(np.take_along_axis(faces, order, axis=1))
