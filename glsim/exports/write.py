"""Find the formats by name, and write the files of each frame."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

from glsim.dataset import Dataset
from glsim.errors import ConfigError, DatasetError
from glsim.exports.base import Export
from glsim.exports.frames import ExportFrame, export_frames
from glsim.files.atomic import temporary_folder, wrap_write_errors, write_atomic
from glsim.plugins import load_plugin, plugin_names, shipped_objects


def _is_export(value: Any) -> bool:
    return isinstance(value, Export)


#: Name -> shipped format.
FORMATS: Final[Mapping[str, Export]] = {
    export.name: export for export in shipped_objects("exports/formats", _is_export)
}


def format_names() -> list[str]:
    """Return the names of the shipped formats and of those that other packages bring."""
    return [*FORMATS, *plugin_names("exports", FORMATS)]


def _find(name: str, out: Path) -> Export:
    """Return a format that can be written to the folder ``out``. Raises as ``export_dataset``."""
    if name not in format_names():
        raise ConfigError(f"no such format {name!r}: it is one of {', '.join(format_names())}")
    if name not in FORMATS:
        plugin: Export = load_plugin("exports", name, _is_export)
        return replace(plugin, name=name)
    export = FORMATS[name]
    if export.library and find_spec(export.library) is None:
        raise ConfigError(f"{name} needs {export.library}: pip install 'glsim[formats]'")
    if not export.replaces and (out / export.file).exists():
        raise DatasetError(f"{out / export.file}: exists already: remove it, or choose another -o")
    return export


def export_dataset(
    dataset: Dataset,
    out: Path | str,
    formats: Sequence[str],
    *,
    layers: Sequence[str] | None = None,
    split: str | None = None,
    count: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> int:
    """Write the frames of a data set to a folder in other formats.

    Files of a frame are OUT/SPLIT/SUBJECT/SEQUENCE_FRAME..., as the images of the data set. They
    replace older ones; a bag does not.

    Args:
        dataset: the data set.
        out: the folder.
        formats: names of formats, see ``glsim export``.
        layers: depth layers, of clean, noisy and expected; default: all.
        split: one split only.
        count: number of frames, the first ones.
        progress: is called with the number of frames that are done.

    Returns:
        The number of frames.

    Raises:
        ConfigError: an argument is wrong, or a library is not installed.
        DatasetError: there is no frame, one cannot be read, or a file cannot be written.
    """
    out = Path(out)
    exports = [_find(name, out) for name in formats]
    if not exports:
        raise ConfigError(f"give at least one format of {', '.join(format_names())}")
    if out.resolve() == dataset.path.resolve():
        raise ConfigError(f"{out}: is the data set itself: choose another folder")

    def frames() -> Iterator[ExportFrame]:
        return export_frames(dataset, layers, split, count)

    encoders = [export.encode for export in exports if export.encode is not None]
    done = _write_files(encoders, frames(), out, progress) if encoders else 0
    for export in exports:
        if export.write is not None:
            done = _write_whole(export, frames(), out)
    if not done:
        raise DatasetError(f"{dataset}: has no frame {'in ' + split if split else 'at all'}")
    return done


def _write_files(
    encoders: Sequence[Callable[[ExportFrame], Iterable[tuple[str, bytes]]]],
    frames: Iterator[ExportFrame],
    out: Path,
    progress: Callable[[int], None] | None,
) -> int:
    """Write the files of each frame; return the number of frames."""
    done = 0
    for done, frame in enumerate(frames, start=1):
        for encode in encoders:
            for end, data in encode(frame):
                write_atomic(data, out / f"{frame.stem}{end}", sync=False)
        if progress is not None:
            progress(done)
    return done


def _write_whole(export: Export, frames: Iterator[ExportFrame], out: Path) -> int:
    """Write all frames into one file or folder, renamed into place at the end; return how many."""
    assert export.write is not None
    with wrap_write_errors(out / export.file):
        out.mkdir(parents=True, exist_ok=True)
        # A bag of ROS 2 holds its own name: what is temporary is the folder around it.
        with temporary_folder(out) as work:
            made = work / export.file
            if done := export.write(frames, made):
                made.replace(out / export.file)
    return done
