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
from glsim.core.errors import ConfigError, DatasetError, DepthRangeError, counted
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
    """A writer of changed depth maps under the names of a recording's files."""

    def __init__(
        self,
        recording: Recording,
        inputs: Sequence[Path | str],
        out: Path,
        form: str | None = None,
        *,
        given_mm: float | None = None,
        finest_mm: float | None = None,
        sigma_out: Path | None = None,
        sensor: str = "",
    ) -> None:
        """Choose the output file and the step of each map.

        Raises ConfigError: two outputs have the same name, an output would replace an input, or a
        step is given for floats.

        Args:
            form: format of all outputs, one of ``FORMATS``. Default: from the suffix of each name.
            given_mm: step of integers. Default: ``finest_mm``, else the step of the recording; a
                PNG file that is too deep for it takes a coarser one.
            finest_mm: step of PNG files, doubled if one of the sampled maps is too deep for it.
            sigma_out: folder or file name of the outputs of the layer "sigma_mm".
            sensor: the sensor that the outputs state. Default: the stated one, in PNG files only
                if it is simulated.
        """
        self._out, self._steps_given = out, given_mm is not None
        #: What a file holds ("in steps of 1 mm") -> the files.
        self._written: dict[str, list[str]] = {}
        camera = recording.stated if recording.is_one_camera else StatedCamera()
        self._simulated_by = sensor or recording.simulated_by
        self.targets = _targets(recording, inputs, out, form)
        self._sources = recording.sources
        self._replaced = sum(map(Path.exists, self.targets))
        self._sigma: list[Path] = []
        if sigma_out is not None:
            self._sigma_out, self._sigma = sigma_out, _targets(recording, inputs, sigma_out, "png")
            if {*self._sigma} & {*self.targets}:
                raise ConfigError(f"{sigma_out}: is the output of the depth: give another name")
        self._forms = [form or format_of(target) for target in self.targets]
        forms = {*self._forms}
        if given_mm is not None and forms <= {*FLOAT_FORMATS}:
            raise ConfigError("--out-unit-mm: floats are metres and have no step: leave it out")
        own_mm, deepest_mm = recording.step_mm, 0.0
        if finest_mm is None or forms != {"png"}:
            finest_mm = own_mm
        elif given_mm is None:
            deepest_mm = recording.votes.deepest_mm
        fits = (s for s in (min(own_mm, finest_mm), finest_mm) if DEEPEST_STEPS * s >= deepest_mm)
        step_mm = given_mm or next(fits, 2 * finest_mm)
        coarser = {own_mm, finest_mm, 2 * finest_mm, 1.0} if given_mm is None else set()
        #: Steps of PNG files, which state theirs; a TIFF file takes the first.
        self._steps_mm = [step_mm, *sorted(s for s in coarser if s > step_mm)]
        tiff_mm = step_mm if "tiff" in forms else None
        self._camera = replace(camera, sensor=sensor or recording.stated.sensor, unit_mm=tiff_mm)

    def write(self, frames: Frames, *, skipped: Callable[[str], None]) -> int:
        """Write the noisy map of each frame; several files get a camera.toml beside them.

        Files of a data set keep the offset of their input.

        Args:
            frames: the changed frames, as many as in the recording and in the same order.
            skipped: called with the reason for each frame that cannot be read.

        Returns the number of frames that could not be read. Raises DatasetError: the only frame
        cannot be read, or a file cannot be written; DepthRangeError: a depth beyond 16 bits.
        """
        alone, failures = len(self.targets) == 1, 0
        for number, target in enumerate(self.targets):
            try:
                frame = frames.load(number)
                depth_mm = frame.noisy_mm
            except DatasetError as error:
                if alone:
                    raise
                failures += 1
                source = str(self._sources[number])
                skipped(str(error) if source in str(error) else f"{source}: {error}")
                continue
            if move_mm := frame.record.get("depth_offset_mm", 0.0) - frame.offset_mm:
                depth_mm = subtract_offset(depth_mm, move_mm, frame.step_mm or 1.0)
            write_atomic(self._encode(frame, depth_mm, number), target, sync=alone)
            if self._sigma and "sigma_mm" in frame:
                write_atomic(_encode_sigma(frame), self._sigma[number], sync=alone)
        if not alone:
            write_camera_file(self._camera, self._out)
            flush_outputs(self._out)
        return failures

    def sentence(self, noisy: str) -> str:
        """Say how many "noisy" maps were written, and in which steps; most files come first."""
        done = counted(sum(map(len, self._written.values())), f"{noisy} depth map")
        text = f"wrote {done} to {self._out}"
        kinds = sorted(self._written.items(), key=lambda kind: -len(kind[1]))
        for number, (holds, files) in enumerate(kinds):
            more = f" and {len(files) - 3} more" if len(files) > 3 else ""
            text += f"; {', '.join(files[:3])}{more} {holds}" if number else f", {holds}"
        if self._sigma:
            text += f"; uncertainties in steps of {_SIGMA_STEP_MM:g} mm to {self._sigma_out}"
        again = counted(self._replaced, "file")
        return f"{text}; {again} of the same name replaced" if self._replaced else text

    def _encode(self, frame: DepthFrame, depth_mm: Depth, number: int) -> bytes:
        """Encode a map, in the finest step that holds it; else what is too deep becomes 0."""
        form, holds, step_mm = self._forms[number], "in float32 metres", self._steps_mm[0]
        if form not in FLOAT_FORMATS:
            steps_mm = self._steps_mm if form == "png" else self._steps_mm[:1]
            deepest_mm = depth_mm.max(initial=0)
            step_mm = next((s for s in steps_mm if deepest_mm <= UINT16_MAX * s), steps_mm[-1])
            holds = f"in steps of {step_mm:g} mm"
            beyond = depth_mm > UINT16_MAX * step_mm
            count = int(beyond.sum())
            if count and self._steps_given:
                raise DepthRangeError(
                    f"{frame.record.get('file', frame.name)}: a depth of {deepest_mm:.0f} mm does "
                    f"not fit 16 bits {holds}: choose a larger --out-unit-mm"
                )
            if count:
                holds += f" without {count} px beyond 16 bits"
                depth_mm = np.where(beyond, np.float32(0), depth_mm)
        holds = holds if depth_mm.any() else "without depth"
        self._written.setdefault(holds, []).append(str(self.targets[number]))
        return encode_map(to_metres(depth_mm), form, step_mm, self._simulated_by)


def _encode_sigma(frame: DepthFrame) -> bytes:
    """Return the uncertainty of a denoised frame as PNG in steps of 0.01 mm, 0 without depth."""
    steps = np.clip(np.rint(frame.layer("sigma_mm") / np.float32(_SIGMA_STEP_MM)), 1, UINT16_MAX)
    return encode_png(np.where(frame.noisy_mm > 0, steps, 0).astype(np.uint16), layer="sigma")


def _targets(
    recording: Recording, inputs: Sequence[Path | str], out: Path, form: str | None
) -> list[Path]:
    """Return the file of each output; if two names are equal, all outputs keep their folders."""
    outputs, sources = recording.outputs, recording.sources
    lone = len(outputs) == 1 and not out.is_dir() and not Path(inputs[0]).is_dir()
    lone = lone and bool(Path(inputs[0]).is_file() or out.suffix)  # else a pattern: a folder
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


def _check_name(out: Path, form: str | None) -> None:
    """Raise ConfigError for an output's suffix that is no depth format, or not ``form``'s."""
    suffixes = SUFFIXES if form is None else FORMATS[form]
    if out.suffix.lower() not in suffixes:
        known = f"{', '.join(suffixes)}, or an existing folder"
        raise ConfigError(f"-o {out}: give a name that ends in {known}")


def _shared(paths: Sequence[Path]) -> Path | None:
    """Return a path that occurs more than once; None without one."""
    return next((path for path, count in Counter(paths).items() if count > 1), None)
