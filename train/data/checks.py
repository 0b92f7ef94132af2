"""Checks of a data set before training, in one pass over its manifest, and its fingerprint."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from glsim.core.depth_frame import Frames
from glsim.core.depth_protocol import offset_to_nearest
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.atomic import file_checksum
from glsim.core.units import subtract_offset
from glsim.data.disk_format import MANIFEST
from glsim.data.reader import Dataset
from glsim.settings.schema import SPLIT_NAMES

#: Cropping of a larger frame: "no" (an error), at the centre, or at random in each epoch.
Cut = Literal["no", "centre", "random"]
#: Target of a network: the true depth, or the depth that the sensor expects without noise.
Target = Literal["clean", "expected"]


def entries_of(**choices: str) -> dict[str, str]:
    """Return a fingerprint's entries that are not default; older trainings have no such entry."""
    return {name: value for name, value in choices.items() if value not in ("clean", "depth")}


def moved_pair(images: NDArray[np.float32]) -> NDArray[np.float32]:
    """Shift a pair to the depth protocol "paper", where the target's nearest point is at 1 mm.

    All depths of ``images`` (C + 1, H, W), inputs and target, are shifted equally, so that
    neighbours in time keep their difference from the frame.
    """
    return subtract_offset(images, offset_to_nearest(images[-1]))


def checked_split(
    dataset: Dataset,
    name: str,
    crop: int | None,
    cut: Cut,
    layers: Sequence[str] = ("noisy", "clean"),
) -> Frames:
    """Open a split and check that it is fit for training, without decoding images.

    Raises DatasetError: the split is empty, a layer was not written, a subject is in two splits,
    frames differ in size or do not fit ``crop``. Raises ConfigError for a crop below 1.

    ``crop``: side of random crops, px; None: whole frames.
    """
    if crop is not None and crop < 1:
        raise ConfigError(f"a crop of {crop} pixels: give 1 or more")
    for layer in layers:
        dataset.require(layer)
    split = dataset.split(name)
    if not len(split):
        have = ", ".join(f"{n} {dataset.header['frames'][n]}" for n in SPLIT_NAMES)
        raise DatasetError(
            f"{dataset}: has no frames in its split {name!r} (frames: {have}): generate one "
            "with other shares (--set split=TRAIN,VAL,TEST)"
        )
    split_of: dict[str, str] = {}
    for pair in dataset:
        this = str(pair.record["split"])
        other = split_of.setdefault(pair.key.subject, this)
        if other != this:
            raise DatasetError(
                f"{dataset}: subject {pair.key.subject} is in {other} and in {this}: scores "
                "on it would be too good: glsim generate splits by subject"
            )
    first = (split[0].intrinsics.height, split[0].intrinsics.width)
    for pair in split:
        size = height, width = pair.intrinsics.height, pair.intrinsics.width
        where = f"{dataset}: {pair.name} is {width} x {height} pixels"
        if crop is None and size != first:
            raise DatasetError(
                f"{where}, frames before it {first[1]} x {first[0]}: a batch needs one size: crop"
            )
        if crop is not None and size != (crop, crop) and (min(size) < crop or cut == "no"):
            raise DatasetError(
                f"{where}, the training asks for {crop} x {crop}: generate with "
                f"--set output.crop={crop}, or change data.crop or data.cut of the recipe"
            )
    return split


def require_videos(dataset: Dataset) -> None:
    """Raise DatasetError if successive frames show other poses: they are no neighbours in time."""
    settings = dataset.header["settings"]
    for name, values in settings["pose"].items():
        if values["per"] == "frame" and "constant" not in values and not settings.get("redraw"):
            why = f"pose.{name} is new in each frame: generate with --set redraw=sequence"
            raise DatasetError(f"{dataset}: has no videos: {why}")


def fingerprint(dataset: Path) -> dict[str, Any]:
    """Return the identity of a data set for checkpoints: equal for equal data in any folder.

    The manifest has the CRC32 of each image, so its own CRC32 depends on all pixels. Raises
    DatasetError if the folder is no data set of glsim.
    """
    opened = Dataset(dataset)
    manifest = file_checksum(opened.path / MANIFEST)
    if manifest is None:
        raise DatasetError(f"{opened.path / MANIFEST}: is missing or cannot be read")
    settings = opened.header["settings"]
    return {
        "manifest_crc32": f"{manifest['crc32']:08x}",
        "frames": {name: int(opened.header["frames"][name]) for name in SPLIT_NAMES},
        "sensor": settings.get("sensor"),
        "sources": [source["kind"] for source in settings.get("source", [])],
        "seed": settings.get("seed"),
        "depth_unit_mm": opened.depth_unit_mm,
    }
