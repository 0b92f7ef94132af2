"""Own the targets that the stages of a frame draw, for one run of a chain or for several."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from glsim.gl.targets import Target, TargetPool
from glsim.noise.frame_context import FrameContext
from glsim.render.renderer import Rendered

#: Layer name -> the target that holds it.
Targets = dict[str, Target]


class StageLayers:
    """Own the targets of one run; return each to its pool once no later stage can read it."""

    def __init__(self) -> None:
        self._pool: TargetPool | None = None
        self._own: list[Target] = []

    @contextmanager
    def run(self, rendered: Rendered, frame: FrameContext) -> Iterator[None]:
        """Own what is drawn in the block, over ``rendered`` for ``frame``."""
        self._pool = rendered.pool
        with rendered.pool.scope() as self._own:
            yield

    def draw(self, name: str, draw: Callable[[], Targets], *inputs: object) -> Targets:
        """Return the layers that the stage ``name`` draws.

        Args:
            inputs: all that they depend on, besides the rendering and the frame.
        """
        drawn = draw()
        self._own += drawn.values()
        return drawn

    def replaced(self, targets: Iterable[Target]) -> None:
        """Give back the targets of layers that a stage has drawn anew."""
        for target in [target for target in targets if target in self._own]:
            self._own.remove(target)
            assert self._pool is not None, "called within run()"
            self._pool.give_back(target)


@dataclass(frozen=True, eq=False)
class _Drawn:
    """The targets that a stage drew, and the inputs that it drew them from."""

    inputs: tuple[object, ...]
    targets: Targets


class KeptLayers(StageLayers):
    """The targets of a frame's last run: the next one draws only stages whose inputs differ.

    Inputs that are layers are told apart by their targets. A target is lent again only after a run
    that did not use it, so that no kept stage has read it.
    """

    def __init__(self) -> None:
        super().__init__()
        self._over: tuple[Rendered, FrameContext] | None = None
        self._stages: dict[str, _Drawn] = {}
        self._used: set[str] = set()
        self._unused: list[Target] = []

    @contextmanager
    def run(self, rendered: Rendered, frame: FrameContext) -> Iterator[None]:
        """Keep what is drawn in the block; what is of another rendering or frame is given back."""
        if self._over is None or self._over[0] is not rendered or self._over[1] != frame:
            self.clear()
            self._over, self._pool = (rendered, frame), rendered.pool
        self._used = set()
        try:
            yield
        except BaseException:
            self.clear()
            raise
        for name in self._stages.keys() - self._used:
            self._drop(name)
        self._give_back()

    def draw(self, name: str, draw: Callable[[], Targets], *inputs: object) -> Targets:
        """Return the layers of the stage ``name``: the kept ones, or new ones if inputs differ."""
        known = self._stages.get(name)
        if known is None or not _same_inputs(known.inputs, inputs):
            drawn = draw()
            self._drop(name)
            known = self._stages[name] = _Drawn(inputs, drawn)
        self._used.add(name)
        return known.targets

    def replaced(self, targets: Iterable[Target]) -> None:
        """Keep the targets: the next run may begin at the stage that reads them."""

    def clear(self) -> None:
        """Give all targets back. Call it before the rendering they were drawn over ends."""
        for name in [*self._stages]:
            self._drop(name)
        self._give_back()
        self._over = None

    def _drop(self, name: str) -> None:
        if name in self._stages:
            self._unused += self._stages.pop(name).targets.values()

    def _give_back(self) -> None:
        for target in self._unused:
            assert self._pool is not None, "drawn within run()"
            self._pool.give_back(target)
        self._unused = []


def _same_inputs(inputs: tuple[object, ...], others: tuple[object, ...]) -> bool:
    """Compare the inputs of a stage: parameter values by value, stages and targets by identity."""
    return len(inputs) == len(others) and all(
        one is two or (isinstance(one, Mapping) and one == two)
        for one, two in zip(inputs, others, strict=True)
    )
