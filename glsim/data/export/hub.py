"""Upload of a data set to the Hugging Face Hub."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple

from glsim.core.errors import ConfigError, DatasetError, require_package
from glsim.core.files.atomic import write_atomic
from glsim.core.files.store import Store
from glsim.data.disk_format import HEADER, MANIFEST, README, SKIPPED, STATE
from glsim.data.header import open_header, read_header
from glsim.data.verification import verify
from glsim.settings.schema import SPLIT_NAMES

#: Names of splits on the Hub.
_HUB_SPLITS: Final = {"train": "train", "val": "validation", "test": "test"}
#: Source of faces -> licence of frames of them, as the Hub names it (docs/licence.md). Nobody
#: claims rights in what glsim computes by itself, nor in results of MakeHuman's body model (CC0);
#: of other faces the owners decide. A frame of several sources is under the last licence.
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


class Pushed(NamedTuple):
    """What an upload sent: address of the repository, number of files, their bytes, files kept."""

    url: str
    files: int
    size_bytes: int
    left_out: list[str]


def push_dataset(place: Path | str, repository: str, *, public: bool = False) -> Pushed:
    """Upload a verified data set to a repository of the Hub, which is created if necessary.

    Only the files that the header and the manifest name go, and README.md, the card that the Hub
    reads (written by ``write_card`` if it is missing). Links are not followed. A second push sends
    what has changed. The token is that of ``hf auth login``, or HF_TOKEN; HF_ENDPOINT names another
    server than the Hub.

    Args:
        place: folder of the data set.
        repository: "owner/name".
        public: whether a new repository can be seen by everybody.

    Raises:
        ConfigError: without huggingface_hub or a token, or for a wrong name.
        DatasetError: the data set is damaged, or the Hub refuses or cannot be reached.
    """
    place = Path(place)
    read_header(place)
    require_package("huggingface_hub", f"--hf {repository}", "hub")
    import huggingface_hub as hub
    from huggingface_hub.errors import HFValidationError

    token = hub.get_token()
    if token is None:
        raise ConfigError(f"--hf {repository}: no token: run hf auth login, or set HF_TOKEN")
    if repository.count("/") != 1:
        raise ConfigError(f"--hf {repository}: give owner/name")
    if problems := verify(place, deep=True, strays=False):
        raise DatasetError(
            f"{place}: {problems[0]}: glsim verify {place} --deep lists all problems"
        )
    if not os.path.lexists(place / README):
        write_card(place)
    sizes = dict(_named_files(Store(place)))
    api = hub.HfApi(token=token, library_name="glsim")
    try:
        url = api.create_repo(repository, repo_type="dataset", private=not public, exist_ok=True)
        api.create_commit(
            repository,
            [hub.CommitOperationAdd(name, place / name) for name in sizes],
            repo_type="dataset",
            commit_message="Data set of glsim",
        )
    except HFValidationError as error:
        raise ConfigError(f"--hf {repository}: {_first_line(error)}") from None
    except Exception as error:  # of its HTTP library, which is another one from version to version
        raise DatasetError(f"--hf {repository}: was not pushed: {_first_line(error)}") from None
    left = (name for name in _all_files(place) if name not in sizes)
    return Pushed(str(url), len(sizes), sum(sizes.values()), sorted(left))


def _named_files(store: Store) -> Iterator[tuple[str, int]]:
    """Yield the name and size, bytes, of each file of a data set. Raises DatasetError for links."""
    header, _, manifest = open_header(store)
    names = dict.fromkeys((HEADER, MANIFEST, SKIPPED, README, *header["files"]))
    for number, line in enumerate(manifest.lines(0, len(manifest))):
        record = manifest.parse(line, number)
        names |= dict.fromkeys(str(file["name"]) for file in record["files"].values())
    for name in names:
        if (size := store.size(name)) is not None:
            yield name, size


def _all_files(place: Path) -> Iterator[str]:
    """Yield the names of all files and links below a folder, but for glsim's own state."""
    for folder, folders, files in os.walk(place):
        if Path(folder) == place and STATE in folders:
            folders.remove(STATE)
        links = (name for name in folders if Path(folder, name).is_symlink())
        yield from (Path(folder, name).relative_to(place).as_posix() for name in (*files, *links))


def _first_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__


def write_card(place: Path) -> Path:
    """Write the README.md of a complete data set, with the metadata that the Hub reads.

    It is no part of the data set. Raises ConfigError without huggingface_hub, DatasetError if the
    data set is not complete.
    """
    require_package("huggingface_hub", "writing the card of a data set", "hub")
    write_atomic(_hub_card(read_header(place)).encode(), place / README)
    return place / README


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
