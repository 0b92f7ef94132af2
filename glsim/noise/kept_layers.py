"""Keep what the stages of a chain drew, so that the same frame with other values draws less."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from glsim.gl.targets import Target, TargetPool
from glsim.noise.frame_context import FrameContext
from glsim.render.renderer import Rendered


@dataclass(frozen=True, eq=False)
class _Drawn:
    """What a stage drew. made_from: all that its result depends on, for one frame."""

    made_from: tuple[object, ...]
    targets: dict[str, Target]


class KeptLayers:
    """The layers of one frame's stages. A stage is drawn again if its code, values or input differ.

    Layers are told apart by their targets. This holds because a target is lent again only after
    a run in which no kept stage has read it.
    """

    def __init__(self) -> None:
        self._over: tuple[Rendered, FrameContext] | None = None
        self._stages: dict[str, _Drawn] = {}
        self._used: set[str] = set()
        self._replaced: list[Target] = []

    def begin(self, rendered: Rendered, frame: FrameContext) -> None:
        """Begin a run; what was kept of another rendering or frame is given back."""
        if self._over is None or self._over[0] is not rendered or self._over[1] != frame:
            self.clear()
            self._over = rendered, frame
        self._used = set()

    def find(self, name: str, *made_from: object) -> dict[str, Target] | None:
        """Return what the stage ``name`` drew from the same; None if it must be drawn."""
        drawn = self._stages.get(name)
        if drawn is None or not _same(drawn.made_from, made_from):
            return None
        self._used.add(name)
        return drawn.targets

    def put(self, name: str, targets: dict[str, Target], *made_from: object) -> None:
        """Keep what a stage has drawn."""
        self._drop(name)
        self._stages[name] = _Drawn(made_from, targets)
        self._used.add(name)

    def end(self) -> None:
        """End a run: give back what it has replaced, and what it has not used."""
        for name in self._stages.keys() - self._used:
            self._drop(name)
        self._give_back()

    def clear(self) -> None:
        """Give everything back, while the rendering's pool still lends its targets."""
        for name in [*self._stages]:
            self._drop(name)
        self._give_back()
        self._over = None

    def _drop(self, name: str) -> None:
        if name in self._stages:
            self._replaced += self._stages.pop(name).targets.values()

    def _give_back(self) -> None:
        if self._over is not None:
            pool: TargetPool = self._over[0].pool
            for target in self._replaced:
                pool.give_back(target)
        self._replaced = []


def _same(made_from: Sequence[object], other: Sequence[object]) -> bool:
    """Compare values by what they are, all else (stages, targets) by identity."""
    return len(made_from) == len(other) and all(
        one is two or (isinstance(one, Mapping | bool) and one == two)
        for one, two in zip(made_from, other, strict=True)
    )
