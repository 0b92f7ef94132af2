"""The arithmetic of a driver: the bits of its functions at fixed arguments."""

from __future__ import annotations

import moderngl

from glsim.gl.draw import FullscreenPass
from glsim.gl.program import link_files

_SIDE = 64


def shader_arithmetic(context: moderngl.Context) -> bytes:
    """Return what the driver computes at 4,096 pixels with sine, logarithm, power, ... (float32).

    Two drivers, or one driver on two processors, may differ in the last bits.
    """
    target = context.texture((_SIDE, _SIDE), 4, dtype="f4")
    framebuffer = context.framebuffer([target])
    framebuffer.use()
    FullscreenPass(context, link_files(context, "render/arithmetic.frag")).draw()
    return bytes(framebuffer.read(components=4, dtype="f4"))
