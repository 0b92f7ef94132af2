"""Runner of a reproduction's steps (data sets, trainings, scores); it skips finished steps.

A step is skipped if its output exists and FOLDER/steps/NAME.json records equal inputs. A step
without an output, such as scoring, runs every time; scoring itself skips finished blocks.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from glsim.core.errors import DatasetError, GlsimError
from glsim.core.files.atomic import read_json, to_json, write_atomic
from glsim.data.disk_format import HEADER
from glsim.data.driver import generate
from glsim.settings.schema import Settings

if TYPE_CHECKING:
    from glsim.train.recipe import Recipe

_T = TypeVar("_T")
_Show = AbstractContextManager[Callable[[Any], None] | None]


@dataclass(frozen=True)
class Displays:
    """Context managers that show progress and detect signals; the default shows nothing."""

    frames: Callable[[str], _Show] = lambda _: nullcontext()
    training: Callable[[str], _Show] = lambda _: nullcontext()
    stopping: Callable[[], AbstractContextManager[Callable[[], bool]]] = lambda: nullcontext(
        lambda: False
    )


@dataclass
class Runner:
    """Runner of the steps of a reproduction, with results in one folder.

    Attributes:
        announce: called with a line before each step.
        dry: whether steps are announced but not run.
    """

    out: Path
    workers: int = 1
    announce: Callable[[str], None] = lambda _: None
    displays: Displays = Displays()
    dry: bool = False
    _start: float = field(default_factory=time.monotonic)

    def step(
        self, name: str, run: Callable[[], _T], inputs: Any = None, output: Path | None = None
    ) -> _T | None:
        """Run a step unless it is complete.

        Returns the result of ``run``; None for a step that was complete.

        Args:
            name: name of the step, unique in the reproduction.
            inputs: JSON values that the output depends on.
            output: file or folder of the complete step; None: run every time.
        """
        record = self.out / "steps" / f"{re.sub(r'[^A-Za-z0-9._-]+', '-', name)}.json"
        inputs = json.loads(json.dumps(inputs))
        before: Any = "none"
        with suppress(DatasetError):  # the step was not finished
            before = read_json(record).get("inputs", before)
        done = output is not None and output.exists() and before == inputs
        minutes = "" if self.dry else f"{(time.monotonic() - self._start) / 60:.0f} min, "
        self.announce(f"{minutes}{name}{': complete' if done else ''}")
        if done or self.dry:
            return None
        try:
            result = run()
        except GlsimError as error:
            raise type(error)(f"{name}: {error}: the same command goes on there") from error
        if output is not None:
            write_atomic(to_json({"inputs": inputs}, str(record)).encode(), record)
        return result

    def generate(self, settings: Settings, folder: Path) -> None:
        """Generate a data set. Raises DatasetError if no frame could be made."""

        def run() -> None:
            with self.displays.frames("") as progress:
                summary = generate(settings, folder, workers=self.workers, progress=progress)
            if not sum(summary.frames.values()):
                raise DatasetError(f"{folder}: no frame could be made, see skipped.jsonl there")

        name = f"generate {self._name(folder)}"
        self.step(name, run, settings.model_dump(mode="json"), folder / HEADER)

    def train(self, recipe: Recipe, data: Sequence[Path], folder: Path) -> None:
        """Train a network, or continue its interrupted training.

        Raises the errors of ``glsim.train.loop.fit``, and KeyboardInterrupt if a signal stops the
        training, after it was saved.
        """

        def run() -> None:
            from glsim.train.batches import stored_batches
            from glsim.train.loop import fit

            pairs = stored_batches(data, recipe)
            with self.displays.stopping() as stop, self.displays.training(recipe.title) as show:
                report = fit(recipe, pairs, folder, resume=True, on_step=show, should_stop=stop)
            if report["state"] == "interrupted":
                raise KeyboardInterrupt

        inputs = [
            recipe.model_dump(mode="json", exclude={"assignments"}),
            [self._name(each) for each in data],
        ]
        self.step(f"train {self._name(folder)}", run, inputs, folder / "best.pt")

    def _name(self, folder: Path) -> str:
        return folder.relative_to(self.out).as_posix()
