"""A tuning (the changes to a sensor as a plain value), and its undo history.

What the page writes (command line, Python, sensor file) has the names and values of ``--set``.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from glsim.settings.toml_tables import toml_value

#: A number, a switch, or a distribution such as {"uniform": [1, 3]}.
Value = Any

#: Largest number of steps that can be undone; a step takes a few hundred bytes.
_HISTORY = 200


@dataclass(frozen=True)
class StageCode:
    """GLSL code that replaces a stage's code, or that adds a new stage.

    Attributes:
        before: name of the stage before which a new stage is inserted.
    """

    text: str
    before: str | None = None
    new: bool = False


@dataclass(frozen=True)
class Tuning:
    """A state of the page's settings; equal tunings give equal frames.

    Attributes:
        values: name in ``--set`` -> value.
        code: stage -> its changed GLSL.
    """

    sensor: str
    values: Mapping[str, Value] = field(default_factory=dict)
    code: Mapping[str, StageCode] = field(default_factory=dict)
    frame: int = 0

    def with_value(self, name: str, value: Value) -> Tuning:
        """Return the tuning with one value changed; None restores the sensor's value."""
        values = {k: v for k, v in self.values.items() if k != name}
        return replace(self, values=values if value is None else {**values, name: value})

    def with_code(self, stage: str, code: StageCode | None) -> Tuning:
        """Return the tuning with a stage's GLSL changed; None restores the sensor's code."""
        kept = {k: v for k, v in self.code.items() if k != stage}
        if code is None and stage in self.code and self.code[stage].new:
            values = {k: v for k, v in self.values.items() if not k.startswith(f"{stage}.")}
            return replace(self, values=values, code=kept)
        return replace(self, code=kept if code is None else {**kept, stage: code})


class History:
    """Tunings of a page in order, with a current position for undo and redo.

    Until ``settle``, successive changes of one name, as of a dragged slider, are one undo step.
    """

    def __init__(self, start: Tuning) -> None:
        self._steps, self._at, self._open = [start], 0, ""

    @property
    def now(self) -> Tuning:
        """The tuning that the page shows now."""
        return self._steps[self._at]

    def change(self, tuning: Tuning, what: str = "") -> bool:
        """Make a tuning the current tuning; return True if it differs."""
        if tuning == self.now:
            return False
        if what and what == self._open and self._at == len(self._steps) - 1:
            self._steps[self._at] = tuning
            return True
        self._steps = [*self._steps[: self._at + 1], tuning][-_HISTORY:]
        self._at = len(self._steps) - 1
        self._open = what
        return True

    def settle(self) -> None:
        """End the current undo step, so that the next change of the same name starts a new step."""
        self._open = ""

    def refuse(self, tuning: Tuning) -> bool:
        """Remove ``tuning`` if it is current and failed to draw; return True if removed."""
        if tuning is not self.now or self._at == 0:
            return False
        self._steps = self._steps[: self._at]
        self._at, self._open = self._at - 1, ""
        return True

    @property
    def can_undo(self) -> bool:
        """Whether there is an earlier tuning."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether there is a later tuning."""
        return self._at < len(self._steps) - 1

    def undo(self) -> Tuning:
        """Go one step back, if there is one."""
        self._at, self._open = max(self._at - 1, 0), ""
        return self.now

    def redo(self) -> Tuning:
        """Go one step forward, if there is one."""
        self._at, self._open = min(self._at + 1, len(self._steps) - 1), ""
        return self.now


def set_options(tuning: Tuning) -> str:
    """Write the options ``--sensor`` and ``--set`` of a command that gives the same frames.

    Stages with changed code are left out: they need a saved sensor file.
    """
    words = ["--sensor", tuning.sensor]
    for name, value in tuning.values.items():
        words += ["--set", f"{name}={toml_value(value)}"]
    return shlex.join(words)


def python_code(tuning: Tuning) -> str:
    """Write Python code that generates the same frames."""
    lines = [
        "from glsim import Simulator, load_settings, make_tasks, open_context, open_sources",
        "",
        f"settings = load_settings(overrides={{'sensor': {tuning.sensor!r}}})",
        "sources = open_sources(settings)",
        "simulator = Simulator(settings, sources, open_context())",
    ]
    for stage, code in tuning.code.items():
        before = f", before={code.before!r}" if code.before else ""
        lines += [f"simulator = simulator.with_stage({stage!r}, {code.text!r}{before})"]
    if tuning.values:
        lines += [f"simulator = simulator.with_values({dict(tuning.values)!r})"]
    lines += [
        "tasks = make_tasks(simulator.settings, sources)",
        f"(frame,) = simulator.frames(tasks[{tuning.frame} : {tuning.frame + 1}])",
        "frame.clean, frame.noisy, frame.infrared, frame.reason",
    ]
    return "\n".join(lines) + "\n"
