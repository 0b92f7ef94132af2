"""A data set as a folder for the Hugging Face Hub: its manifest's files and a dataset card."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.cloud import open_store
from glsim.core.files.store import Store
from glsim.data.disk_format import HEADER, MANIFEST, README, SKIPPED
from glsim.data.header import open_header
from glsim.data.verification import verify
from glsim.settings.schema import SPLIT_NAMES

#: Names of splits on the Hub.
_HUB_SPLITS: Final = {"train": "train", "val": "validation", "test": "test"}
#: Source of faces -> the Hub's name of the licence of its frames (docs/reference/licence.md).
#: Nobody claims rights in glsim's heads, or in results of MakeHuman's body model (CC0). The owners
#: of other faces decide their licence. Of several sources, the last one in this order decides.
_LICENCES: Final = {"procedural": "cc0-1.0", "people": "cc0-1.0", "ict-facekit": "mit"}
_OTHER: Final = "other"
_TEXT: Final = """# {title}

Frames of a depth camera ({frames}), written by glsim {version}. Layers: {layers}.
Depth is 16-bit, in steps of {unit_mm:g} mm, 0 = no return; add `depth_offset_mm` of a record for
the distance from the camera. `manifest.jsonl` has one record per frame, `dataset.json` all
settings.

```python
from glsim import open_dataset

for pair in open_dataset("PATH OF THIS FOLDER").split("train"):
    pair.clean_mm, pair.noisy_mm, pair.intrinsics
```
"""


def write_hub_folder(source: str, out: Path) -> None:
    """Copy a verified data set to a folder, with README.md, the card that the Hub reads.

    Only the files of the header and the manifest are copied; links are not followed. Raises
    ConfigError if the folder ``out`` is not empty (an upload would send all of it), DatasetError if
    the data set is damaged, or a file cannot be written.
    """
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise ConfigError(f"{out}: is not empty: choose a new folder, all of it will be uploaded")
    if problems := verify(source, deep=True, strays=False):
        raise DatasetError(
            f"{source}: {problems[0]}: glsim verify {source} --deep lists all problems"
        )
    store = open_store(source)
    header = open_header(store)[0]
    target = Store(out)
    for name in _named_files(store):
        with store.open(name) as file, target.create(name, sync=False) as copy:
            shutil.copyfileobj(file, copy)
    target.put(README, dataset_card(header).encode())
    target.flush()


def _named_files(store: Store) -> Iterator[str]:
    """Yield the name of each file of a data set. Raises DatasetError for links."""
    header, _, manifest = open_header(store)
    names = dict.fromkeys((HEADER, MANIFEST, SKIPPED, *header["files"]))
    for number, line in enumerate(manifest.lines(0, len(manifest))):
        record = manifest.parse(line, number)
        names |= dict.fromkeys(str(file["name"]) for file in record["files"].values())
    return (name for name in names if store.size(name) is not None)


def licence_of(header: Mapping[str, Any]) -> str:
    """Return the Hub's name of the frames' licence, "other" if owners of faces decide."""
    kinds = {str(source["kind"]) for source in header["settings"].get("source", [])}
    recorded = "clean" not in header["settings"]["output"]["layers"]
    if recorded or not kinds or kinds - _LICENCES.keys():
        return _OTHER
    return max((_LICENCES[kind] for kind in kinds), key=[*_LICENCES.values()].index)


def _title(header: Mapping[str, Any]) -> str:
    kinds = sorted({str(s["kind"]) for s in header["settings"].get("source", [])})
    sensor = header["sensor"].get("name", "a sensor")
    return f"Depth of {' and '.join(kinds) or 'given'} faces seen by {sensor}"


def dataset_card(header: Mapping[str, Any]) -> str:
    """Return the text of README.md, whose YAML the Hub reads, for the header of a data set."""
    counts, output, licence = header["frames"], header["settings"]["output"], licence_of(header)
    pattern = "{}/**" if output["format"] == "png" else "{}-*.tar"
    files = [
        {"split": _HUB_SPLITS[split], "path": pattern.format(split)}
        for split in SPLIT_NAMES
        if counts[split]
    ]
    # Keys of huggingface.co/docs/hub/datasets-cards; JSON is YAML on one line.
    metadata: dict[str, Any] = {
        "license": licence,
        **({"license_name": "licence-of-the-faces"} if licence == _OTHER else {}),
        "pretty_name": _title(header),
        "task_categories": ["image-to-image", "depth-estimation"],
        "tags": ["depth", "denoising", "faces", "glsim"],
        "configs": [{"config_name": "default", "data_files": files}],
    }
    yaml = "\n".join(f"{key}: {json.dumps(value)}" for key, value in metadata.items())
    text = _TEXT.format(
        title=_title(header),
        frames=", ".join(f"{counts[split]} {split}" for split in SPLIT_NAMES),
        version=header["glsim_version"],
        layers=", ".join(output["layers"]),
        unit_mm=header["depth_unit_mm"],
    )
    return f"---\n{yaml}\n---\n\n{text}"
