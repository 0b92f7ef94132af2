"""Textures for layers, reused between frames, and copies of them in NumPy arrays."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.core.rect import Rect
from glsim.gl.declarations import Layer

_BYTES_PER_NUMBER = 4


@dataclass(eq=False)
class Target:
    """A float32 texture that holds a layer and is zero outside the window ``drawn``."""

    texture: moderngl.Texture
    layer: Layer
    drawn: Rect


class TargetPool:
    """A pool of reusable targets for the layers of frames of one size.

    ``take`` clears older windows, so that stages read zero outside the current window.
    """

    def __init__(self, context: moderngl.Context, width: int, height: int) -> None:
        self.context = context
        self.width, self.height = width, height
        self._free: dict[tuple[int, float], list[Target]] = defaultdict(list)
        self._framebuffers: dict[tuple[int, ...], moderngl.Framebuffer] = {}

    def take(self, layer: Layer, window: Rect, *, clean: bool = True) -> Target:
        """Lend a target for ``layer`` that is zero outside ``window`` (frame pixels).

        ``clean``: False skips the clearing and keeps ``drawn``; the caller then clears the target.
        """
        free = self._free[(layer.components, float(layer.scale))]
        if free:
            target = free.pop()
            target.layer = layer
        else:
            size = (math.ceil(self.width * layer.scale), math.ceil(self.height * layer.scale))
            texture = self.context.texture(size, layer.components, dtype="f4")
            texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
            texture.repeat_x = texture.repeat_y = False
            target = Target(texture, layer, Rect(0, 0, *size))
        if not clean:
            return target
        drawn = layer.window(window)
        if not drawn.contains(target.drawn):
            framebuffer = self.framebuffer([target])
            framebuffer.use()
            framebuffer.clear(viewport=target.drawn)
        target.drawn = drawn
        return target

    def give_back(self, target: Target) -> None:
        """Return a target to the pool."""
        self._free[(target.layer.components, float(target.layer.scale))].append(target)

    @contextmanager
    def scope(self) -> Iterator[list[Target]]:
        """Yield an empty list; at the end of the block, return its targets to the pool."""
        held: list[Target] = []
        try:
            yield held
        finally:
            for target in reversed(held):  # the next frame takes them in the same order
                self.give_back(target)

    def framebuffer(
        self, targets: Sequence[Target], depth: moderngl.Renderbuffer | None = None
    ) -> moderngl.Framebuffer:
        """Return the framebuffer that draws into ``targets``; it is made once and kept."""
        key = (0 if depth is None else depth.glo, *(target.texture.glo for target in targets))
        if key not in self._framebuffers:
            textures = [target.texture for target in targets]
            self._framebuffers[key] = self.context.framebuffer(textures, depth)
        return self._framebuffers[key]

    def upload(self, layer: Layer, values: NDArray[np.float32]) -> Target:
        """Lend a full-frame target with the values of a float32 array (H, W[, components])."""
        target = self.take(layer, Rect(0, 0, self.width, self.height))
        target.texture.write(np.ascontiguousarray(values, dtype=np.float32).tobytes())
        return target


class Readback:
    """The copy of a frame's layers to memory, through a pixel buffer.

    ``request`` queues the copy; ``arrays`` waits for it, while a GPU draws the next frames.
    """

    def __init__(self, context: moderngl.Context) -> None:
        self._context = context
        self._buffer: moderngl.Buffer | None = None
        self._parts: dict[str, tuple[int, tuple[int, ...]]] = {}
        self._size = 0

    def request(self, pool: TargetPool, targets: Mapping[str, Target], window: Rect) -> None:
        """Queue the copy of ``window`` (frame pixels) of all ``targets``, name -> target."""
        self._parts, self._size = {}, 0
        for name, target in targets.items():
            rect, components = target.layer.window(window), target.layer.components
            shape = (rect.height, rect.width) + ((components,) if components > 1 else ())
            self._parts[name] = self._size, shape
            self._size += math.prod(shape) * _BYTES_PER_NUMBER
        if self._buffer is None or self._buffer.size < self._size:
            self._buffer = self._context.buffer(reserve=self._size)
        for name, target in targets.items():
            pool.framebuffer([target]).read_into(
                self._buffer,
                viewport=target.layer.window(window),
                components=target.layer.components,
                dtype="f4",
                write_offset=self._parts[name][0],
            )

    def arrays(self) -> dict[str, NDArray[np.float32]]:
        """Wait for the copy; return the window's float32 layers, (h, w) or (h, w, components)."""
        assert self._buffer is not None, "call request() first"
        data = self._buffer.read(self._size)
        return {
            name: np.frombuffer(data, np.float32, math.prod(shape), start).reshape(shape)
            for name, (start, shape) in self._parts.items()
        }


def set_matrix(program: moderngl.Program, name: str, matrix: NDArray[np.float32]) -> None:
    """Set a matrix uniform from a NumPy matrix, transposed to OpenGL's column order."""
    uniform: Any = program[name]
    uniform.write(np.ascontiguousarray(matrix.T))
