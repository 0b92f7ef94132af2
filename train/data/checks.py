"""What must hold of a data set before hours are spent on it, in one pass over its manifest."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from glsim.config import SPLIT_NAMES
from glsim.dataset import Dataset, Split
from glsim.dataset.files import check_of, reading
from glsim.dataset.layout import MANIFEST
from glsim.errors import ConfigError, DatasetError

#: How frames larger than the crop are cut: not at all (they are an error), around their centre, or
#: at a place that is drawn anew for each epoch.
Cut = Literal["no", "centre", "random"]
LAYERS = ("noisy", "clean")


def checked_split(dataset: Dataset, name: str, crop: int | None, cut: Cut) -> Split:
    """A split that can be trained on. Images are not decoded: damage in them is found by reading.

    Raises DatasetError: the split is empty, a layer was not written, a subject is in two splits, a
    file is missing or cut short, frames differ in size or do not fit ``crop``. Raises ConfigError
    for a crop that no frame could have.
    """
    if crop is not None and crop < 1:
        raise ConfigError(f"a crop of {crop} pixels: give 1 or more")
    split = dataset.split(name)
    if not len(split):
        have = ", ".join(f"{n} {dataset.header['frames'][n]}" for n in SPLIT_NAMES)
        raise DatasetError(
            f"{dataset.path}: has no frames in its split {name!r} (frames: {have}): generate one "
            "with other shares (--split)"
        )
    for layer in LAYERS:
        if layer not in dataset.layers:
            raise DatasetError(
                f"{dataset.path}: has no layer {layer!r}: generate it with --layers clean,noisy"
            )
    _check_subjects(dataset)
    _check_frames(dataset, split, crop, cut)
    return split


def _check_subjects(dataset: Dataset) -> None:
    """Who is trained on must be nobody who is tested on."""
    split_of: dict[str, str] = {}
    for pair in dataset:
        other = split_of.setdefault(pair.subject, pair.split)
        if other != pair.split:
            raise DatasetError(
                f"{dataset.path}: subject {pair.subject} is in {other} and in {pair.split}: a test "
                "on it would flatter: glsim generate splits by subject"
            )


def _check_frames(dataset: Dataset, split: Split, crop: int | None, cut: Cut) -> None:
    first = (split[0].intrinsics.height, split[0].intrinsics.width)
    sizes: dict[str, int] = {}
    for pair in split:
        size = (pair.record["intrinsics"]["height"], pair.record["intrinsics"]["width"])
        _check_size(f"{dataset.path}: {pair!r}", size, crop, cut)
        if crop is None and size != first:
            raise DatasetError(
                f"{dataset.path}: {pair!r} is {size[1]} x {size[0]} pixels, frames before it "
                f"{first[1]} x {first[0]}: a batch needs one size: give a crop"
            )
        for layer in LAYERS:
            _check_file(dataset.path, pair.record["files"][layer], sizes)


def _check_size(where: str, size: tuple[int, int], crop: int | None, cut: Cut) -> None:
    if crop is None or size == (crop, crop):
        return
    if min(size) < crop or cut == "no":
        raise DatasetError(
            f"{where} is {size[1]} x {size[0]} pixels, the training asks for {crop} x {crop}: "
            f"generate with --crop {crop}, or train on others (data.crop, data.cut of the recipe)"
        )


def _check_file(root: Path, file: Mapping[str, Any], sizes: dict[str, int]) -> None:
    """The file is there and holds all of the image; ``sizes`` remembers those of shards."""
    path = root / file["name"]
    if file["name"] not in sizes:
        with reading(path):
            size = path.stat().st_size
        if "offset" in file:
            sizes[file["name"]] = size
    else:
        size = sizes[file["name"]]
    if size < file.get("offset", 0) + file["size"]:
        raise DatasetError(
            f"{path}: is cut short: run glsim generate again with the same settings to repair it"
        )


def fingerprint(dataset: Path) -> dict[str, Any]:
    """What a checkpoint says of the data it has seen; equal for equal data, wherever they lie.

    The manifest holds every image's CRC32, so that its own stands for all pixels. Raises
    DatasetError for what is no data set of glsim.
    """
    opened = Dataset(dataset)
    manifest = check_of(opened.path / MANIFEST)
    if manifest is None:
        raise DatasetError(f"{opened.path / MANIFEST}: is missing or cannot be read")
    settings = opened.header["settings"]
    return {
        "manifest_crc32": f"{manifest['crc32']:08x}",
        "frames": {name: int(opened.header["frames"][name]) for name in SPLIT_NAMES},
        "sensor": settings["sensor"],
        "sources": [source["kind"] for source in settings["source"]],
        "seed": int(settings["seed"]),
        "depth_unit_mm": opened.depth_unit_mm,
    }
