"""Where a frame shows anything at all, for passes that have nothing to do elsewhere.

A face covers a third of its window. Rasterisers test depth before they shade, so that a depth
buffer in which empty pixels are nearer than the pass skips them: a third of the window costs a
third of the time, where branches in a shader save nothing on a software rasteriser.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import moderngl

from glsim.bounds import union
from glsim.frame import Rect
from glsim.gl.program import link_files
from glsim.gl.targets import Target, TargetPool

#: What layers hold where a pass is skipped: as if it had been drawn there.
Blank = dict[str, float]


class Silhouette:
    """The depth buffer, for targets of one pool that have the frame's size."""

    def __init__(self, pool: TargetPool) -> None:
        self._pool, self._context = pool, pool.context
        program = link_files(self._context, "render/fullscreen.vert", "render/silhouette.frag")
        program["u_seen"] = 0
        self._array = self._context.vertex_array(program, [])
        self._depth = self._context.depth_renderbuffer((pool.width, pool.height))
        self._own = self._context.framebuffer([], self._depth)
        self._framebuffers: dict[tuple[int, ...], moderngl.Framebuffer] = {}
        #: Whether the last frame has empty pixels that are worth skipping.
        self.leaves_out = False

    def draw(self, seen: Target, window: Rect) -> None:
        """Take the frame's silhouette, widened by a pixel. seen: more than 0 within it."""
        self.leaves_out = window.width < self._pool.width or window.height < self._pool.height
        if not self.leaves_out:  # a background: everything is seen
            return
        self._own.use()
        self._own.viewport = window
        self._own.clear(depth=1.0, viewport=window)
        seen.texture.use(0)
        self._context.enable_only(moderngl.DEPTH_TEST)
        self._array.render(moderngl.TRIANGLES, vertices=3)
        self._context.enable_only(moderngl.NOTHING)

    @contextmanager
    def limits(
        self, targets: Sequence[Target], window: Rect, blank: Blank | None, flags: int = 0
    ) -> Iterator[None]:
        """Passes that are drawn meanwhile reach ``targets`` within the silhouette only.

        Elsewhere targets hold 0, or what ``blank`` says for their layer; what they
        held before if it is None. flags: what else is to be enabled (moderngl.BLEND).
        """
        key = tuple(target.texture.glo for target in targets)
        if key not in self._framebuffers:
            textures = [target.texture for target in targets]
            self._framebuffers[key] = self._context.framebuffer(textures, self._depth)
            self._framebuffers[key].depth_mask = False
        buffer = self._framebuffers[key]
        buffer.use()
        buffer.viewport = window
        if blank is not None:  # once, for a clear takes as long as a simple pass
            buffer.clear(viewport=union([window, *(t.drawn for t in targets if t.drawn)]))
            for target in targets:
                target.drawn = window
                if target.layer.name in blank:
                    one = self._pool.framebuffer([target])
                    one.clear(blank[target.layer.name], viewport=window)
        buffer.use()
        self._context.enable_only((moderngl.DEPTH_TEST if self.leaves_out else 0) | flags)
        yield
        self._context.enable_only(moderngl.NOTHING)
