"""The frame maker of a data set: a simulator that runs only on machines with equal arithmetic."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

from glsim.data.arithmetic import Machine, this_machine
from glsim.faces.face_source import FaceSource
from glsim.gl.context import borrowed_context
from glsim.settings.schema import Settings
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.pipeline import Simulator
from glsim.simulation.plan.tasks import Task


@dataclass
class SameMachineSimulator:
    """A FrameMaker that simulates only if this machine computes like the first machine.

    Attributes:
        sources, backend, layers: see ``glsim.simulation.pipeline.simulate``.
        keep: keep context and simulator for further calls in this process; linking the shader
            programs again takes as long as about ten frames.
    """

    machine: Machine
    sources: Sequence[FaceSource]
    backend: str | None
    layers: Collection[str]
    keep: bool = False
    _kept: tuple[Simulator, ExitStack] | None = field(default=None, init=False)

    def __call__(self, settings: Settings, tasks: Iterable[Task]) -> Iterator[Frame | Skipped]:
        """Yield one Frame or Skipped per task, in order.

        Raises ConfigError if this process computes differently, and the errors of ``simulate``.
        """
        if self._kept is not None:
            yield from self._kept[0].frames(tasks)
            return
        with ExitStack() as stack:
            context = stack.enter_context(borrowed_context(self.backend))
            this_machine(context).refuse_other(self.machine)
            simulator = Simulator(settings, list(self.sources), context, (), self.layers)
            if self.keep:
                self._kept = simulator, stack.pop_all()
            yield from simulator.frames(tasks)
