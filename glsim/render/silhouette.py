"""Silhouettes: depth masks that limit full-screen passes to pixels with a surface.

A face covers a third of its window. Rasterisers test the depth before they shade a pixel. If the
depth buffer is nearer than the pass in empty pixels, they are skipped, and a pass takes a third of
the time. Branches in a shader save no time on a software rasteriser.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import moderngl

from glsim.core.bounds import union
from glsim.core.rect import Rect
from glsim.gl.draw import FullscreenPass
from glsim.gl.program import link_files
from glsim.gl.targets import Target, TargetPool

#: Layer name -> its value in skipped pixels, if it is not 0.
Blank = dict[str, float]


class Silhouette:
    """The depth mask of a frame, for targets of one pool that have the frame's size."""

    def __init__(self, pool: TargetPool) -> None:
        self._pool, self._context = pool, pool.context
        self._depth = self._context.depth_renderbuffer((pool.width, pool.height))
        #: The framebuffer that draws the mask itself.
        self.mask = self._context.framebuffer([], self._depth)
        #: Whether passes skip the empty pixels; False if the whole frame has a surface.
        self.skips_empty = False

    @contextmanager
    def limits(
        self, targets: Sequence[Target], window: Rect, blank: Blank | None, flags: int = 0
    ) -> Iterator[None]:
        """Limit the passes in the block, drawn into ``targets``, to the silhouette.

        ``blank``: layer -> value outside the silhouette, 0 for other layers; None: no change.
        ``flags``: further GL capabilities to enable (moderngl.BLEND).
        """
        buffer = self._pool.framebuffer(targets, self._depth)
        buffer.depth_mask = False
        buffer.use()
        buffer.viewport = window
        if blank is not None:  # one clear for all targets, since it takes as long as a simple pass
            buffer.clear(viewport=union([window, *(t.drawn for t in targets)]))
            for target in targets:
                target.drawn = window
                if target.layer.name in blank:
                    single = self._pool.framebuffer([target])
                    single.clear(blank[target.layer.name], viewport=window)
        buffer.use()
        self._context.enable_only((moderngl.DEPTH_TEST if self.skips_empty else 0) | flags)
        yield
        self._context.enable_only(moderngl.NOTHING)


class SilhouettePass:
    """A pass that draws silhouettes for the frames of a target pool, and reuses their buffers."""

    def __init__(self, pool: TargetPool) -> None:
        self._pool, self._context = pool, pool.context
        self._free: list[Silhouette] = []
        program = link_files(self._context, "render/silhouette.frag")
        self._pass = FullscreenPass(self._context, program)

    @contextmanager
    def draw(self, seen: Target | None, window: Rect) -> Iterator[Silhouette]:
        """Yield the silhouette of the pixels with ``seen`` > 0, widened by 1 px; None: all pixels.

        The silhouette is reused after the block.
        """
        silhouette = self._free.pop() if self._free else Silhouette(self._pool)
        # A window as large as the frame shows a background, which covers every pixel.
        smaller = window.width < self._pool.width or window.height < self._pool.height
        silhouette.skips_empty = seen is not None and smaller
        if seen is not None and smaller:
            silhouette.mask.use()
            silhouette.mask.clear(depth=1.0, viewport=window)
            self._context.enable_only(moderngl.DEPTH_TEST)
            self._pass.draw(silhouette.mask, window, seen=seen)
            self._context.enable_only(moderngl.NOTHING)
        try:
            yield silhouette
        finally:
            self._free.append(silhouette)
