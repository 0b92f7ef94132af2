"""One loop that writes depth maps: each frame of a set to a file of its own, named as its input."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from glsim.core.depth_frame import DepthFrame, Frames
from glsim.core.depth_protocol import subtract_offset
from glsim.core.errors import ConfigError, DatasetError, DepthRangeError
from glsim.core.files.atomic import flush_outputs, write_atomic
from glsim.core.files.png import encode_png
from glsim.core.units import UINT16_MAX, to_metres
from glsim.data.map_files import FLOAT_FORMATS, FORMATS, SUFFIXES, encode_map, format_of
from glsim.data.recording import Recording

#: Step of denoised PNG files, which state it, mm: rounding to it adds 0.03 mm. Whole millimetres
#: cost a network 4 to 8 % of its error.
FINE_MM: Final = 0.1
#: Deepest input for it, mm: 16 bits hold 6,553.5 mm, and denoising adds some. Chosen.
_DEEPEST_MM: Final = 6500.0


#: Step of uncertainties in PNG files, mm: 16 bits reach 0.65 m.
SIGMA_STEP_MM: Final = 0.01


class MapWriter:
    """Writes the maps of a recording, changed, under the names of its files.

    Attributes:
        targets: file of each map.
        step_mm: of whole numbers, mm; None: all are float32 metres.
    """

    def __init__(
        self,
        recording: Recording,
        inputs: Sequence[Path | str],
        out: Path,
        form: str | None = None,
        *,
        step_mm: float | None = None,
        option: str = "--out-unit-mm",
        states_step: bool = True,
    ) -> None:
        """Name the output of each map.

        Args:
            recording: whose maps are changed.
            inputs: from which it was opened.
            out: folder, or file name for one map.
            form: format of all outputs, one of ``FORMATS``; default: by their suffixes.
            step_mm: of whole numbers; default: that of the recording.
            option: that gives the step, named in messages.
            states_step: PNG files state their step.

        Raises:
            ConfigError: two outputs have one name, or one would replace an input.
        """
        self._option, self._form, self._states_step = option, form, states_step
        self.targets = _targets(recording, inputs, out, form)
        self._out = out
        self.step_mm = None if self.forms <= {*FLOAT_FORMATS} else step_mm or recording.step_mm

    @property
    def forms(self) -> set[str]:
        """The formats of the outputs, of ``FORMATS``."""
        return {self._form or format_of(target) for target in self.targets}

    def choose_step(self, recording: Recording, given_mm: float | None) -> None:
        """Take the given step, or 0.1 mm for PNG files if no map that votes is too deep for it.

        Raises ConfigError if a step is given for floats.
        """
        if self.step_mm is None:
            if given_mm is not None:
                raise ConfigError(
                    f"{self._option}: floats are metres and have no step: leave it out"
                )
        elif given_mm is not None:
            self.step_mm = given_mm
        elif self.forms == {"png"} and recording.votes.deepest_mm <= _DEEPEST_MM:
            self.step_mm = min(self.step_mm, FINE_MM)

    def write(
        self,
        frames: Frames,
        layer: str = "noisy_mm",
        *,
        skipped: Callable[[str], None],
        written: Callable[[int, DepthFrame], None] = lambda *_: None,
    ) -> int:
        """Write a layer of each frame; files of a data set keep the offset of their input.

        Args:
            frames: as many as the recording has, in its order.
            layer: of depth, mm.
            skipped: called with the reason for each frame that cannot be read.
            written: called with the number and the frame of each map that was written.

        Returns:
            The number of frames that could not be read.

        Raises:
            DatasetError: the only frame cannot be read, or a file cannot be written.
            DepthRangeError: a depth is beyond 16 bits of the step.
        """
        alone, failures = len(self.targets) == 1, 0
        for number, target in enumerate(self.targets):
            try:
                frame = frames.load(number)
                depth_mm = frame.layer(layer)
            except DatasetError as error:
                if alone:
                    raise
                failures += 1
                skipped(str(error))
                continue
            if move_mm := frame.record.get("depth_offset_mm", 0.0) - frame.offset_mm:
                depth_mm = subtract_offset(depth_mm, move_mm, frame.step_mm or 1.0)
            form = self._form or format_of(target)
            try:
                data = encode_map(
                    to_metres(depth_mm), form, self.step_mm or 1.0, self._option,
                    state_unit=self._states_step,
                )  # fmt: skip
            except DepthRangeError as error:
                raise DepthRangeError(f"{frame.record.get('file', frame.name)}: {error}") from None
            write_atomic(data, target, sync=alone)
            written(number, frame)
        if not alone:
            flush_outputs(self._out)
        return failures


def write_sigma(frame: DepthFrame, target: Path) -> None:
    """Write the uncertainty of a denoised frame as PNG in steps of 0.01 mm, 0 without depth."""
    steps = np.clip(np.rint(frame.layer("sigma_mm") / np.float32(SIGMA_STEP_MM)), 1, UINT16_MAX)
    data = encode_png(np.where(frame.noisy_mm > 0, steps, 0).astype(np.uint16))
    write_atomic(data, target, sync=False)


def _targets(
    recording: Recording, inputs: Sequence[Path | str], out: Path, form: str | None
) -> list[Path]:
    """Return the file of each output; where two have one name, all keep their folders."""
    outputs, sources = recording.outputs, recording.sources
    if len(outputs) == 1 and not out.is_dir() and not Path(inputs[0]).is_dir():
        _check_name(out, form)
        targets = [out]
    elif out.is_file():
        raise ConfigError(f"-o {out}: is a file; for several maps give a folder")
    elif out.suffix.lower() in SUFFIXES and not out.is_dir():
        raise ConfigError(f"-o {out}: is the name of one map; for several give that of a folder")
    else:
        targets = [out / _writable(output, form) for output in outputs]
    if _shared(targets):
        shared = os.path.commonpath([source.absolute().parent for source in sources])
        below = [source.absolute().relative_to(shared).parent for source in sources]
        targets = [out / folder / t.name for folder, t in zip(below, targets, strict=True)]
        if same := _shared(targets):
            pairs = zip(sources, targets, strict=True)
            twice = next(source for source, target in pairs if target == same)
            raise ConfigError(f"{twice}: is given twice, or two maps would be {same}")
    for source, target in zip(sources, targets, strict=True):
        if target.exists() and source.exists() and target.samefile(source):
            raise ConfigError(f"-o {out}: would overwrite {source}")
    return targets


def _writable(output: Path, form: str | None) -> Path:
    """Return the name of an output in the given format, or PNG for inputs that are only read."""
    if form is not None:
        return output.with_suffix(FORMATS[form][0])
    return output if output.suffix.lower() in SUFFIXES else output.with_suffix(".png")


def _check_name(out: Path, form: str | None = None) -> None:
    """Raise ConfigError for the name of an output that is no depth map, or not of the format."""
    suffixes = SUFFIXES if form is None else FORMATS[form]
    if out.suffix.lower() not in suffixes:
        raise ConfigError(
            f"-o {out}: give a name that ends in {', '.join(suffixes)}, or an existing folder"
        )


def _shared(paths: Sequence[Path]) -> Path | None:
    """Return a path that is there more than once; None without one."""
    return next((path for path, count in Counter(paths).items() if count > 1), None)
