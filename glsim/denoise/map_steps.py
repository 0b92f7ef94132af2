"""The step of depth files in whole numbers, mm: of those that are read, and of those written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.dataset.header import read_header
from glsim.denoise.depth_files import dataset_root
from glsim.errors import ConfigError, DatasetError, DepthRangeError
from glsim.files.png import read_depth_png, stated_unit_mm
from glsim.map_files import FLOAT_FORMATS, encode_map, format_of

#: Step of denoised maps where a reader can know it, mm: rounding to it adds 0.03 mm, and depth up
#: to 6.5 m fits 16 bits. Whole millimetres cost a network 4 to 8 % of its error.
FINE_MM: Final = 0.1
#: Deepest value of an input, in units of 0.1 mm, that leaves room for what denoising adds. Chosen.
_DEEPEST: Final = 65000


def unit_mm(files: Sequence[Path], given: float | None) -> float:
    """Return the step of depth files, mm: the one that they state, else ``given``, else 1.

    Files of a data set state it in its header, PNG files of ``glsim denoise`` themselves.

    Raises:
        ConfigError: steps differ, since a wrong step moves every face without looking wrong.
        DatasetError: the header of the data set, or what a file states, is damaged.
    """
    stated = _stated_mm(files)
    if len(stated) > 1:
        raise ConfigError(
            "the maps are of different steps, of data sets or as they state themselves: denoise "
            "those of one step at a time"
        )
    found = next(iter(stated), None)
    if found is not None and given is not None and given != found:
        raise ConfigError(
            f"--depth-unit-mm {given:g}: these maps have steps of {found:g} mm, as their data set "
            "or they themselves state: leave the option out"
        )
    return found or given or 1.0


@dataclass(frozen=True)
class MapWriter:
    """Encodes denoised maps: ``forms`` of each map, and the step of those in whole numbers, mm."""

    forms: Sequence[str]
    step_mm: float

    def encode(self, number: int, source: Path, depth_m: NDArray[np.float32]) -> bytes:
        """Return the file of a map, (H, W) metres; PNG states its step.

        Raises DepthRangeError, naming ``source``, for depth beyond 16 bits of the step.
        """
        try:
            return encode_map(
                depth_m, self.forms[number], self.step_mm, "--out-unit-mm", state_unit=True
            )
        except DepthRangeError as error:
            raise DepthRangeError(f"{source}: {error}") from None

    def unit(self) -> str:
        """Return the unit of the files, for a message."""
        return "float32 metres" if _are_floats(self.forms) else f"steps of {self.step_mm:g} mm"


def map_writer(
    pairs: Sequence[tuple[Path, Path]], step_mm: float, form: str | None, given_mm: float | None
) -> MapWriter:
    """Return the writer of denoised maps.

    Args:
        pairs: (input, output) of each map.
        step_mm: step of the input.
        form: format of all outputs, one of ``FORMATS``; default: by their suffixes.
        given_mm: step of the output; default: 0.1 where a reader can know it, else ``step_mm``.

    Raises:
        ConfigError: a step is given for floats.
    """
    forms = [form or format_of(target) for _, target in pairs]
    if given_mm is not None and _are_floats(forms):
        raise ConfigError("--out-unit-mm: floats are metres and have no step: leave it out")
    if given_mm is None and all(form == "png" for form in forms):
        given_mm = _fine_mm([source for source, _ in pairs], step_mm)
    return MapWriter(forms, given_mm or step_mm)


def _are_floats(forms: Sequence[str]) -> bool:
    return all(form in FLOAT_FORMATS for form in forms)


def _fine_mm(files: Sequence[Path], step_mm: float) -> float:
    """Return 0.1 mm if the input states its step and is not too deep for it, else ``step_mm``."""
    if step_mm <= FINE_MM or not _stated_mm(files):
        return step_mm
    most = _DEEPEST * FINE_MM / step_mm
    for file in files:
        try:
            if read_depth_png(file, inside=dataset_root(file.parent)).max(initial=0) > most:
                return step_mm
        except DatasetError:  # reported when it is denoised
            continue
    return FINE_MM


def _stated_mm(files: Sequence[Path]) -> set[float]:
    """Return the steps that files state; of several, those that state none count as 1 mm."""
    roots = {folder: dataset_root(folder) for folder in {file.parent for file in files}}
    headers = {root: float(read_header(root)["depth_unit_mm"]) for root in roots.values() if root}
    stated = set()
    for file in files:
        root = roots[file.parent]
        stated.add(stated_unit_mm(file) if root is None else headers[root])
    if stated == {None}:
        return set()
    return {1.0 if step is None else step for step in stated}
