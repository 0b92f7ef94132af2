"""Selection of export formats by name, and writing of each frame's files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from glsim.core.errors import ConfigError, DatasetError, require_package
from glsim.core.files.atomic import write_atomic
from glsim.core.plugins import load_plugin, plugin_names, shipped_objects
from glsim.data.export.exported_frame import Export, export_frames
from glsim.data.export.hub_folder import write_hub_folder
from glsim.data.reader import Dataset


def _is_export(value: Any) -> bool:
    return isinstance(value, Export)


FORMATS: Final[Mapping[str, Export]] = {
    export.name: export for export in shipped_objects("data/export/formats", _is_export)
}

#: Name of the format that copies the data set and adds its card.
HUB: Final = "hf"


def format_names() -> list[str]:
    """Return the names of all export formats, shipped and from plug-ins."""
    return [*FORMATS, HUB, *plugin_names("exports", (*FORMATS, HUB))]


def _find(name: str) -> Export:
    if name not in format_names():
        raise ConfigError(f"no such format {name!r}: it is one of {', '.join(format_names())}")
    if name not in FORMATS:
        plugin: Export = load_plugin("exports", name, _is_export)
        return replace(plugin, name=name)
    export = FORMATS[name]
    if export.library:
        require_package(export.library, name, "formats")
    return export


def export_dataset(
    dataset: Dataset, out: Path | str, formats: Sequence[str], *,
    layers: Sequence[str] | None = None, split: str | None = None, count: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> int:  # fmt: skip
    """Write the frames of a data set to a folder in the chosen formats; return their number.

    Files of a frame are named OUT/SPLIT/SUBJECT/SEQUENCE_FRAME..., like the images of the data set,
    and replace older files. The format hf, alone, copies the whole data set and adds a card.

    Args:
        layers: depth layers: clean, noisy, expected. Default: all.
        count: number of frames, from the first on.

    Raises:
        ConfigError: an argument is wrong, or a library is not installed.
        DatasetError: there is no frame, one cannot be read, or a file cannot be written.
    """
    out = Path(out)
    if HUB in formats:
        if len(formats) > 1 or any(option is not None for option in (layers, split, count)):
            raise ConfigError(f"{HUB} is the whole data set as it is: give no other format or part")
        write_hub_folder(str(dataset), out)
        return len(dataset)
    exports = [_find(name) for name in formats]
    if not exports:
        raise ConfigError(f"give at least one format of {', '.join(format_names())}")
    if out.resolve() == dataset.path.resolve():
        raise ConfigError(f"{out}: is the data set itself: choose another folder")
    done = 0
    for done, frame in enumerate(export_frames(dataset, layers, split, count), start=1):
        for export in exports:
            for end, data in export.encode(frame):
                write_atomic(data, out / f"{frame.name}{end}", sync=False)
        if progress is not None:
            progress(done)
    if not done:
        raise DatasetError(f"{dataset}: has no frame {'in ' + split if split else 'at all'}")
    return done
