"""Compose a frame of sub-frames at several times: bands of rows, or captures of light.

sub-frame's layers --copy.frag, rows of a band--> layers of a rolling shutter
sub-frame's light --capture.frag, added up-----> light of a time-of-flight frame
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager

import moderngl

from glsim.core.camera import TAPS, SubExposure
from glsim.core.rect import Rect
from glsim.gl.draw import FullscreenPass
from glsim.gl.program import link_files
from glsim.gl.targets import Target, TargetPool
from glsim.render.renderer import Rendered

#: The layers that hold a frame's light; the captures are added up to them.
LIGHT_LAYERS = ("light_a", "light_b")


class SubFrames:
    """A composer of frames from sub-frames, in one GL context."""

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._copy = FullscreenPass(context, link_files(context, "render/copy.frag"))
        self._capture = FullscreenPass(context, link_files(context, "render/capture.frag"))

    def rows(
        self, parts: Sequence[SubExposure], draw: Callable[[int], AbstractContextManager[Rendered]],
        window: Rect, height: int,
    ) -> dict[str, Target]:  # fmt: skip
        """Compose the layers of a frame from bands of rows, each of which has its own sub-frame.

        The caller gives the targets back to their pool. ``draw`` renders the sub-frame of a band,
        given by its number; ``height`` is that of the whole image, px.
        """
        layers: dict[str, Target] = {}
        for number, part in enumerate(parts):
            assert part.rows is not None, "a part of a rolling shutter"
            first, end = (round(share * height) for share in part.rows)
            top, bottom = max(first, window.top), min(end, window.top + window.height)
            if bottom <= top:
                continue
            band = Rect(window.left, top, window.width, bottom - top)
            with draw(number) as rendered:
                for name, source in rendered.layers.items():
                    if name not in layers:
                        layers[name] = rendered.pool.take(source.layer, window)
                    buffer = rendered.pool.framebuffer([layers[name]])
                    self._context.enable_only(moderngl.NOTHING)
                    self._copy.draw(buffer, source.layer.window(band), layer=source)
        return layers

    def add_capture(
        self, pool: TargetPool, part: SubExposure, light: Mapping[str, Target], sums: list[Target]
    ) -> None:
        """Add the light of one capture, in its tap and frequency, to the light of a frame.

        ``light``: the LIGHT_LAYERS of its sub-frame; ``sums``: their targets, 0 before the first.
        """
        assert part.capture is not None, "a capture"
        program = self._capture.program
        program["u_tap"], program["u_frequency"] = part.capture % TAPS, part.capture // TAPS
        self._context.blend_func = moderngl.ONE, moderngl.ONE
        self._context.enable_only(moderngl.BLEND)
        self._capture.draw(pool.framebuffer(sums), sums[0].drawn, **light)
        self._context.enable_only(moderngl.NOTHING)
