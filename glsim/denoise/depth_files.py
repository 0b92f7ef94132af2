"""Depth-map files on the command line: which ones, their outputs, infrared images and steps."""

from __future__ import annotations

import glob
import os
from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.atomic import read_json
from glsim.core.files.listing import natural
from glsim.core.files.png import stated_unit_mm
from glsim.data.disk_format import FORMAT, HEADER
from glsim.data.map_files import (
    FLOAT_FORMATS,
    FORMATS,
    SATURATED,
    SUFFIXES,
    format_of,
    read_stored,
)
from glsim.data.recordings.camera_file import agreed_unit_mm
from glsim.data.recordings.files import FramePlace, MapFiles
from glsim.data.recordings.folders import stated_camera
from glsim.data.recordings.names import infrared_files, maps_in

#: Step of denoised maps where a reader can know it, mm: rounding to it adds 0.03 mm, and depth up
#: to 6.5 m fits 16 bits. Whole millimetres cost a network 4 to 8 % of its error.
FINE_MM: Final = 0.1
#: Deepest value of an input, in units of 0.1 mm, that leaves room for what denoising adds. Chosen.
_DEEPEST: Final = 65000


def find_maps(
    inputs: Sequence[str], out: Path, form: str | None = None
) -> tuple[list[tuple[Path, Path]], Counter[str]]:
    """Pair input files with output files.

    Args:
        inputs: files, quoted patterns, and folders, of which the noisy ``maps_in`` are taken.
        out: folder, or file name for one map.
        form: format of the output, one of ``FORMATS``; default: by the suffix.

    Returns:
        (input, output) of each map, in natural order of the inputs, and what of folders is left
        out. Where two have the same name, all keep their folders below the one that they share.

    Raises:
        ConfigError: no file matches, one is given twice, or one would be overwritten.
    """
    left_out: Counter[str] = Counter()
    pairs = [pair for text in inputs for pair in _of_one(text, out, left_out)]
    pairs.sort(key=lambda pair: natural(pair[0]))
    if len(pairs) == 1 and not out.is_dir() and not Path(inputs[0]).is_dir():
        check_name(out, form)
        pairs = [(pairs[0][0], out)]
    elif out.is_file():
        raise ConfigError(f"-o {out}: is a file; for several maps give a folder")
    elif out.suffix.lower() in SUFFIXES and not out.is_dir():
        raise ConfigError(f"-o {out}: is the name of one map; for several give that of a folder")
    elif form is not None:
        pairs = [(source, target.with_suffix(FORMATS[form][0])) for source, target in pairs]
    if _shared([target for _, target in pairs]):
        shared = os.path.commonpath([source.absolute().parent for source, _ in pairs])
        pairs = [(source, out / source.absolute().relative_to(shared)) for source, _ in pairs]
        if twice := _shared([source for source, _ in pairs]):
            raise ConfigError(f"{twice}: is given twice")
        if same := _shared([target for _, target in pairs]):
            raise ConfigError(f"-o {out}: two maps would be {same}: denoise them one by one")
    for source, target in pairs:
        if target.exists() and target.samefile(source):
            raise ConfigError(f"-o {out}: would overwrite {source}")
    return pairs, left_out


def check_name(out: Path, form: str | None = None) -> None:
    """Raise ConfigError for the name of an output that is no depth map, or not of the format."""
    suffixes = SUFFIXES if form is None else FORMATS[form]
    if out.suffix.lower() not in suffixes:
        raise ConfigError(
            f"-o {out}: give a name that ends in {', '.join(suffixes)}, or an existing folder"
        )


def check_infrared(maps: MapFiles) -> None:
    """Raise ConfigError if a map has no infrared image."""
    for depth, infrared in map(maps.files, range(len(maps))):
        if infrared is None:
            raise ConfigError(
                f"{depth}: has no infrared image beside it ({depth.stem}_infrared.png), which this "
                "denoiser uses: give one with --infrared, or choose the network face"
            )


def dataset_root(folder: Path) -> Path | None:
    """Return the data set of a folder <split>/<subject>/, where one writes maps; else None."""
    split = folder.absolute().parent
    header = split.parent / HEADER
    if not header.is_file():
        return None
    from glsim.settings.schema import SPLIT_NAMES

    if split.name not in SPLIT_NAMES:
        return None
    try:
        ours = read_json(header).get("format") == FORMAT
    except DatasetError:  # a file of that name may have another origin
        return None
    return split.parent if ours else None


def map_files(
    files: Sequence[Path],
    given: float | None,
    channel: str | None = None,
    infrared: Path | None = None,
) -> MapFiles:
    """Open depth maps of one step: the one that they state, else ``given``, else 1 mm.

    infrared: see ``infrared_files``; by default the images beside the maps.

    Files of a data set state it in its header, PNG files of ``glsim denoise`` themselves, others by
    ``stated_camera``.

    Raises:
        ConfigError: steps differ, since a wrong step moves every face without looking wrong.
        DatasetError: the header of the data set, or what a file states, is damaged; and as
            ``MapFiles``.
    """
    stated = _stated_mm(files)
    if len(stated) > 1:
        raise ConfigError(
            "the maps are of different steps, of data sets or as they state themselves: take "
            "those of one step at a time"
        )
    step_mm = agreed_unit_mm(given, next(iter(stated), None), "a file or its data set")
    lights = None if infrared is None else infrared_files(files, infrared)
    return MapFiles([FramePlace(file.stem, file) for file in files], step_mm, channel, lights)


def output_step_mm(
    pairs: Sequence[tuple[Path, Path]], step_mm: float, form: str | None, given_mm: float | None
) -> float | None:
    """Return the step of denoised maps, mm; None for float32 metres.

    Args:
        pairs: (input, output) of each map.
        step_mm: step of the input.
        form: format of all outputs, one of ``FORMATS``; default: by their suffixes.
        given_mm: step of the output; default: 0.1 for PNG files, which state it, if no input is
            too deep for it, else ``step_mm``.

    Raises:
        ConfigError: a step is given for floats.
    """
    forms = {form or format_of(target) for _, target in pairs}
    if forms <= {*FLOAT_FORMATS}:
        if given_mm is not None:
            raise ConfigError("--out-unit-mm: floats are metres and have no step: leave it out")
        return None
    if given_mm is None and forms == {"png"}:
        given_mm = _fine_mm([source for source, _ in pairs], step_mm)
    return given_mm or step_mm


def _fine_mm(files: Sequence[Path], step_mm: float) -> float:
    """Return 0.1 mm if no input is too deep for it, else ``step_mm``."""
    if step_mm <= FINE_MM:
        return step_mm
    most = _DEEPEST * FINE_MM / step_mm
    for file in files:
        with suppress(DatasetError):  # reported when it is denoised
            image = read_stored(file)
            if image[image < SATURATED].max(initial=0) > most:
                return step_mm
    return FINE_MM


def _stated_mm(files: Sequence[Path]) -> set[float]:
    """Return the steps that files state; of several, those that state none count as 1 mm."""
    folders: dict[Path, float | None] = {}
    for folder in {file.parent for file in files}:
        if (root := dataset_root(folder)) is None:
            folders[folder] = stated_camera(folder)[0].unit_mm
        else:
            from glsim.data.header import read_header

            folders[folder] = float(read_header(root)["depth_unit_mm"])
    stated = {stated_unit_mm(file) or folders[file.parent] for file in files}
    return set() if stated == {None} else {1.0 if step is None else step for step in stated}


def _of_one(text: str, out: Path, left_out: Counter[str]) -> list[tuple[Path, Path]]:
    """Pair the files of one input. Raises ConfigError if there is none."""
    path = Path(text)
    if path.is_dir():
        files, others = maps_in(path, "noisy")
        left_out += others
        pairs = [(file, out / file.relative_to(path)) for file in files]
    else:
        # Unlike that of pathlib, it leaves out hidden files.
        matching = [text] if path.is_file() else glob.iglob(text, recursive=True)  # noqa: PTH207
        pairs = [(Path(f), out / Path(f).name) for f in matching if Path(f).is_file()]
    if not pairs:
        raise ConfigError(f"{text}: no such file, folder of depth maps, or pattern")
    return pairs


def _shared(paths: Sequence[Path]) -> Path | None:
    """Return a path that is there more than once; None without one."""
    return next((path for path, count in Counter(paths).items() if count > 1), None)
