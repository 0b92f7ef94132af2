"""Writing of changed depth maps: one output file for each input map, with the input's name."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from glsim.core.array_types import Depth
from glsim.core.depth_frame import DepthFrame, Frames
from glsim.core.errors import ConfigError, DatasetError, DepthRangeError
from glsim.core.files.atomic import flush_outputs, write_atomic
from glsim.core.files.png import encode_png
from glsim.core.units import UINT16_MAX, subtract_offset, to_metres
from glsim.data.map_files import FLOAT_FORMATS, FORMATS, SUFFIXES, encode_map, format_of
from glsim.data.recording import Recording
from glsim.data.recordings.camera_file import StatedCamera, write_camera_file

#: Largest input depth, in steps, for a finer step. Chosen: a larger changed depth must fit 16 bits.
DEEPEST_STEPS: Final = 65_000
#: Step of uncertainties in PNG files, mm; 16 bits then reach 0.65 m.
_SIGMA_STEP_MM: Final = 0.01


class MapWriter:
    """A writer of changed depth maps under the names of a recording's files.

    ``step_mm``: step of integers, mm; None if all outputs are float32 metres.
    """

    def __init__(
        self,
        recording: Recording,
        inputs: Sequence[Path | str],
        out: Path,
        form: str | None = None,
        *,
        given_mm: float | None = None,
        option: str = "--out-unit-mm",
        finest_mm: float | None = None,
        sigma_out: Path | None = None,
        sensor: str = "",
    ) -> None:
        """Choose the output file and the step of each map.

        Raises ConfigError: two outputs have the same name, an output would replace an input, or a
        step is given for floats.

        Args:
            form: format of all outputs, one of ``FORMATS``. Default: from the suffix of each name.
            given_mm: step of integers. Default: ``finest_mm``, else the step of the recording.
            finest_mm: step of PNG files, doubled if one of the sampled maps is too deep for it; a
                map that is deeper still keeps the step of its input.
            sigma_out: folder or file name of the outputs of the layer "sigma_mm".
            sensor: the sensor that the outputs state. Default: the stated one, in PNG files only
                if it is simulated.
        """
        self._option, self._out = option, out
        camera = recording.stated if recording.is_one_camera else StatedCamera()
        self._camera = replace(camera, sensor=sensor or recording.stated.sensor)
        self._simulated_by = sensor or recording.simulated_by
        self.targets = _targets(recording, inputs, out, form)
        self._sources = recording.sources
        self._sigma: list[Path] = []
        if sigma_out is not None:
            self._sigma = _targets(recording, inputs, sigma_out, "png")
            if {*self._sigma} & {*self.targets}:
                raise ConfigError(f"{sigma_out}: is the output of the depth: give another name")
        self._forms = [form or format_of(target) for target in self.targets]
        forms = {*self._forms}
        self.step_mm: float | None = given_mm or recording.step_mm
        if forms <= {*FLOAT_FORMATS}:
            if given_mm is not None:
                raise ConfigError(f"{option}: floats are metres and have no step: leave it out")
            self.step_mm = None
        elif given_mm is None and finest_mm is not None and forms == {"png"}:
            fits = recording.votes.deepest_mm <= DEEPEST_STEPS * finest_mm
            self.step_mm = min(recording.step_mm, finest_mm if fits else 2 * finest_mm)
        coarser = [recording.step_mm] if given_mm is None else []
        tiff_mm = self.step_mm if "tiff" in forms else None  # PNG files state their steps
        self._camera = replace(self._camera, unit_mm=tiff_mm)
        self._steps_mm = dict.fromkeys([self.step_mm or 1.0, *coarser])

    def write(
        self, frames: Frames, layer: str = "noisy_mm", *, skipped: Callable[[str], None]
    ) -> int:
        """Write one layer of each frame to its file; several files get a camera.toml beside them.

        Files of a data set keep the offset of their input.

        Args:
            frames: the changed frames, as many as in the recording and in the same order.
            skipped: called with the reason for each frame that cannot be read.

        Returns the number of frames that could not be read.

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
                source = str(self._sources[number])
                skipped(str(error) if source in str(error) else f"{source}: {error}")
                continue
            if move_mm := frame.record.get("depth_offset_mm", 0.0) - frame.offset_mm:
                depth_mm = subtract_offset(depth_mm, move_mm, frame.step_mm or 1.0)
            data = self._encode(frame, depth_mm, self._forms[number])
            write_atomic(data, target, sync=alone)
            if self._sigma and "sigma_mm" in frame:
                write_atomic(_encode_sigma(frame), self._sigma[number], sync=alone)
        if not alone:
            write_camera_file(self._camera, self._out)
            flush_outputs(self._out)
        return failures

    def _encode(self, frame: DepthFrame, depth_mm: Depth, form: str) -> bytes:
        """Encode a map; if it is too deep for a step that no option gave, use its input's step."""
        depth_m, problem = to_metres(depth_mm), ""
        for step_mm in self._steps_mm:
            try:
                return encode_map(depth_m, form, step_mm, self._option, self._simulated_by)
            except DepthRangeError as error:
                problem = str(error)
        raise DepthRangeError(f"{frame.record.get('file', frame.name)}: {problem}")


def _encode_sigma(frame: DepthFrame) -> bytes:
    """Return the uncertainty of a denoised frame as PNG in steps of 0.01 mm, 0 without depth."""
    steps = np.clip(np.rint(frame.layer("sigma_mm") / np.float32(_SIGMA_STEP_MM)), 1, UINT16_MAX)
    return encode_png(np.where(frame.noisy_mm > 0, steps, 0).astype(np.uint16))


def _targets(
    recording: Recording, inputs: Sequence[Path | str], out: Path, form: str | None
) -> list[Path]:
    """Return the file of each output; if two names are equal, all outputs keep their folders."""
    outputs, sources = recording.outputs, recording.sources
    lone = len(outputs) == 1 and not out.is_dir() and not Path(inputs[0]).is_dir()
    if lone and (sources[0].suffix.lower() in SUFFIXES or out.suffix):
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
    for folder in map(Path, inputs):
        if folder.is_dir() and out.absolute().is_relative_to(folder.absolute()):
            raise ConfigError(f"-o {out}: lies in {folder}, and would be read with it next time")
    return targets


def _writable(output: Path, form: str | None) -> Path:
    """Return the output's name for a format; PNG replaces formats that are only read."""
    if form is not None:
        return output.with_suffix(FORMATS[form][0])
    return output if output.suffix.lower() in SUFFIXES else output.with_suffix(".png")


def _check_name(out: Path, form: str | None = None) -> None:
    """Raise ConfigError for an output's suffix that is no depth format, or not ``form``'s."""
    suffixes = SUFFIXES if form is None else FORMATS[form]
    if out.suffix.lower() not in suffixes:
        raise ConfigError(
            f"-o {out}: give a name that ends in {', '.join(suffixes)}, or an existing folder"
        )


def _shared(paths: Sequence[Path]) -> Path | None:
    """Return a path that occurs more than once; None without one."""
    return next((path for path, count in Counter(paths).items() if count > 1), None)
