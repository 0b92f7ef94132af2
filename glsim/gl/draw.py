"""Draw meshes with a depth test, and shade every pixel of a viewport."""

from __future__ import annotations

from collections.abc import Sequence

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.core.rect import Rect
from glsim.gl.program import link_files
from glsim.gl.targets import Target, set_matrix


class FullscreenPass:
    """A program that shades every pixel of the current framebuffer's viewport."""

    def __init__(self, context: moderngl.Context, program: moderngl.Program) -> None:
        """Make a pass of a program that was linked with render/fullscreen.vert."""
        self.program = program
        self._array = context.vertex_array(program, [])

    def draw(
        self, buffer: moderngl.Framebuffer | None = None, window: Rect | None = None, **read: Target
    ) -> None:
        """Shade every pixel of the viewport once.

        ``read``: target for each sampler u_NAME.
        """
        if buffer is not None and window is not None:
            buffer.use()
            buffer.viewport = window
        for unit, (name, target) in enumerate(read.items()):
            target.texture.use(unit)
            self.program[f"u_{name}"] = unit
        self._array.render(moderngl.TRIANGLES, vertices=3)


def draw_meshes(
    context: moderngl.Context,
    arrays: Sequence[moderngl.VertexArray],
    views: Sequence[NDArray[np.float32]],
    origin_m: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> None:
    """Draw the front faces of meshes into the current framebuffer, with a depth test.

    Args:
        arrays: one for each mesh; ``extra`` tells whether its back faces are drawn too.
        views: for each mesh a (4, 4) matrix, canonical millimetres to camera-frame metres.
        origin_m: the point of view, camera frame, metres.
    """
    # The clip matrix has y down, which mirrors the order of vertices: front faces are clockwise.
    context.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
    context.front_face, context.cull_face = "cw", "back"
    for array, view in zip(arrays, views, strict=True):
        moved = view.copy()
        moved[:3, 3] -= origin_m
        set_matrix(array.program, "u_view", moved)
        (context.disable if array.extra else context.enable)(moderngl.CULL_FACE)
        array.render()
    context.enable_only(moderngl.NOTHING)


def index_buffer(
    context: moderngl.Context, faces: NDArray[np.int32], vertices: int
) -> tuple[moderngl.Buffer, int]:
    """Upload the (F, 3) triangles of a mesh; return the buffer and the bytes per index.

    The software rasteriser reads 16-bit indices 4 % faster; up to 65,536 vertices have them.
    """
    short = vertices <= 1 << 16
    return context.buffer(faces.astype(np.uint16 if short else np.uint32)), 2 if short else 4


def shader_arithmetic(context: moderngl.Context) -> bytes:
    """Compute sine, logarithm, power, ... with the driver at 4,096 pixels: float32 bytes.

    Two drivers, or one driver on two processors, may differ in the last bits.
    """
    target = context.texture((64, 64), 4, dtype="f4")
    framebuffer = context.framebuffer([target])
    framebuffer.use()
    FullscreenPass(context, link_files(context, "render/arithmetic.frag")).draw()
    return bytes(framebuffer.read(components=4, dtype="f4"))
