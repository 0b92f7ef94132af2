"""The cards of a data set for publication: README.md of the Hugging Face Hub, and croissant.json.

The libraries of the extra ``hub`` write them: huggingface_hub, and mlcroissant for MLCommons'
format Croissant. They are no part of a data set: its bytes do not depend on installed libraries.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from glsim.core.errors import require_package
from glsim.core.files.atomic import write_atomic
from glsim.data.disk_format import CROISSANT, MANIFEST, README
from glsim.data.header import read_header
from glsim.settings.schema import SPLIT_NAMES

#: Names of splits on the Hub.
_HUB_SPLITS: Final = {"train": "train", "val": "validation", "test": "test"}
#: Source of faces -> licence of frames of them, as the Hub names it (docs/licence.md). Nobody
#: claims rights in what glsim computes by itself, nor in results of MakeHuman's body model (CC0);
#: of other faces the owners decide. A frame of several sources is under the last licence.
_LICENCES: Final = {"procedural": "cc0-1.0", "people": "cc0-1.0", "ict-facekit": "mit"}
_OTHER: Final = "other"
#: Column of the manifest -> its name in ``mlcroissant.DataType``.
_COLUMNS: Final = {"index": "INTEGER", "split": "TEXT", "subject": "TEXT", "frame": "INTEGER"}
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


def write_cards(place: Path) -> list[Path]:
    """Write README.md and croissant.json into a complete data set, and return their paths.

    Raises ConfigError without the libraries, DatasetError if the data set is not complete.
    """
    for package in ("huggingface_hub", "mlcroissant"):
        require_package(package, "writing the cards of a data set", "hub")
    header = read_header(place)
    manifest = hashlib.sha256((place / MANIFEST).read_bytes()).hexdigest()
    cards = {README: _hub_card(header), CROISSANT: _croissant(header, manifest)}
    for name, text in cards.items():
        write_atomic(text.encode(), place / name)
    return [place / name for name in cards]


def licence_of(header: Mapping[str, Any]) -> str:
    """Return the licence of the frames as the Hub names it, "other" if owners of faces decide."""
    kinds = {str(source["kind"]) for source in header["settings"].get("source", [])}
    recorded = "clean" not in header["settings"]["output"]["layers"]
    if recorded or not kinds or kinds - _LICENCES.keys():
        return _OTHER
    return max((_LICENCES[kind] for kind in kinds), key=[*_LICENCES.values()].index)


def _title(header: Mapping[str, Any]) -> str:
    kinds = sorted({str(s["kind"]) for s in header["settings"].get("source", [])})
    sensor = header["sensor"].get("name", "a sensor")
    return f"Depth of {' and '.join(kinds) or 'given'} faces seen by {sensor}"


def _hub_card(header: Mapping[str, Any]) -> str:
    from huggingface_hub import DatasetCardData

    counts, output, licence = header["frames"], header["settings"]["output"], licence_of(header)
    pattern = "{}/**" if output["format"] == "png" else "{}-*.tar"
    files = [
        {"split": _HUB_SPLITS[split], "path": pattern.format(split)}
        for split in SPLIT_NAMES
        if counts[split]
    ]
    data = DatasetCardData(
        license=licence,
        license_name="licence-of-the-faces" if licence == _OTHER else None,
        pretty_name=_title(header),
        task_categories=["image-to-image", "depth-estimation"],
        tags=["depth", "denoising", "faces", "glsim"],
        configs=[{"config_name": "default", "data_files": files}],
    )
    text = _TEXT.format(
        title=_title(header),
        frames=", ".join(f"{counts[split]} {split}" for split in SPLIT_NAMES),
        version=header["glsim_version"],
        layers=", ".join(output["layers"]),
        unit_mm=header["depth_unit_mm"],
    )
    return f"---\n{data.to_yaml()}\n---\n\n{text}"


def _croissant(header: Mapping[str, Any], manifest_sha256: str) -> str:
    import mlcroissant as mlc

    tree = header["settings"]["output"]["format"] == "png"
    kind, pattern = ("image/png", "*/*/*.png") if tree else ("application/x-tar", "*.tar")
    manifest = mlc.FileObject(
        id=MANIFEST, name=MANIFEST, content_url=MANIFEST, sha256=manifest_sha256,
        encoding_formats=["application/jsonlines"],
    )  # fmt: skip
    images = mlc.FileSet(id="images", name="images", encoding_formats=[kind], includes=[pattern])
    fields = [
        mlc.Field(
            id=f"frames/{name}", name=f"frames/{name}",
            data_types=[getattr(mlc.DataType, data_type)],
            source=mlc.Source(file_object=MANIFEST, extract=mlc.Extract(column=name)),
        )
        for name, data_type in _COLUMNS.items()
    ]  # fmt: skip
    metadata = mlc.Metadata(
        name=f"glsim-{header['sensor'].get('name', 'sensor')}",
        description=_title(header),
        license=[licence_of(header)],
        version="1.0.0",
        distribution=[manifest, images],
        record_sets=[mlc.RecordSet(id="frames", name="frames", fields=fields)],
    )
    return json.dumps(metadata.to_json(), indent=1, default=str) + "\n"
