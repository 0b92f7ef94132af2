"""Find the triangles of a topology that are visible from outside, by rendering it."""

from __future__ import annotations

from collections.abc import Iterable

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.gl.context import open_context
from glsim.gl.program import link_files
from glsim.gl.targets import set_matrix

#: Side of the square image in pixels, and in the millimetres that it covers: 0.7 mm per pixel.
_SIDE_PX, _SIDE_MM = 640, 450.0


def visible_triangles(
    faces: NDArray[np.int32],
    views: Iterable[tuple[NDArray[np.float32], NDArray[np.float32]]],
) -> NDArray[np.bool_]:
    """Mark the triangles that any view shows, and those that share a corner with them: (F,) bool.

    Raises DeviceError without OpenGL.

    Args:
        faces: (F, 3).
        views: (V, 3) vertices in millimetres with a (3, 3) rotation; the camera looks along -z.
    """
    context = open_context()
    try:
        program = link_files(context, "render/identify.frag", "render/identify.vert")
        picture = context.texture((_SIDE_PX, _SIDE_PX), 1, dtype="f4")
        depth = context.depth_renderbuffer((_SIDE_PX, _SIDE_PX))
        buffer = context.framebuffer([picture], depth)
        indices = context.buffer(np.ascontiguousarray(faces))
        positions = context.buffer(reserve=12 * (int(faces.max()) + 1), dynamic=True)
        array = context.vertex_array(program, [(positions, "3f", "in_position_mm")], indices)
        context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        shown = np.zeros(len(faces) + 1, dtype=bool)
        for vertices, rotation in views:
            clip = np.eye(4, dtype=np.float32)
            clip[:3, :3] = rotation * (2.0 / _SIDE_MM)
            clip[2] *= -1  # the nearest surface has the largest z
            set_matrix(program, "u_clip", clip)
            positions.write(np.ascontiguousarray(vertices))
            buffer.use()
            buffer.clear()
            array.render()
            numbers = np.frombuffer(buffer.read(components=1, dtype="f4"), np.float32)
            shown[numbers.astype(np.int32)] = True
    finally:
        context.release()
    corners = np.zeros(int(faces.max()) + 1, dtype=bool)
    corners[faces[shown[1:]]] = True
    return np.asarray(corners[faces].any(axis=1), dtype=np.bool_)
