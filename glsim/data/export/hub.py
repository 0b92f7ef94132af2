"""Upload of a data set to the Hugging Face Hub."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from glsim.core.errors import ConfigError, DatasetError, require_package
from glsim.core.files.atomic import write_atomic
from glsim.data.disk_format import README, STATE
from glsim.data.header import read_header
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


def push_dataset(place: Path | str, repository: str, *, public: bool = False) -> str:
    """Upload a complete data set to a repository of the Hub, which is created if necessary.

    The files go as they are, with a card (``write_card``) unless README.md is there: the Hub reads
    it and shows the splits. A second push sends what has changed. The token is that of ``hf auth
    login``, or HF_TOKEN; HF_ENDPOINT names another server than the Hub.

    Args:
        place: folder of the data set.
        repository: "owner/name".
        public: whether a new repository can be seen by everybody.

    Returns:
        The address of the repository.

    Raises:
        ConfigError: without huggingface_hub or a token, or for a wrong name.
        DatasetError: the data set is not complete, or the Hub refuses or cannot be reached.
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
    if not (place / README).is_file():
        write_card(place)
    api = hub.HfApi(token=token, library_name="glsim")
    try:
        url = api.create_repo(repository, repo_type="dataset", private=not public, exist_ok=True)
        api.upload_folder(
            repo_id=repository,
            folder_path=place,
            repo_type="dataset",
            commit_message="Data set of glsim",
            ignore_patterns=[f"{STATE}/**"],
        )
    except HFValidationError as error:
        raise ConfigError(f"--hf {repository}: {_first_line(error)}") from None
    except Exception as error:  # of its HTTP library, which is another one from version to version
        raise DatasetError(f"--hf {repository}: was not pushed: {_first_line(error)}") from None
    return str(url)


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
