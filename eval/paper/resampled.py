"""Noise by resampling: depth maps that are reduced and enlarged again, beside the clean ones."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.denoise.interface import Depth
from glsim.errors import ConfigError
from glsim.eval.scoring.pairs import open_frames
from glsim.files.atomic import wrap_write_errors, write_atomic
from glsim.files.png import encode_png


def resampled(clean_mm: Depth, factor: int) -> NDArray[np.uint16]:
    """Return (H, W) uint16 mm of a map that is reduced ``factor`` times and enlarged again.

    As photographs are in super-resolution: each pixel of the small map is the mean of factor x
    factor pixels, and the large one is their bicubic interpolation. Holes are depth 0 in both
    steps, as to every program for images, so that rims get depths between 0 and the surface's.

    Args:
        clean_mm: (H, W) mm, 0 = no depth.
        factor: 2 or more.

    Raises:
        ConfigError: the small map would be empty.
    """
    height, width = clean_mm.shape
    if min(height, width) < factor:
        raise ConfigError(f"--factor {factor}: larger than the maps of {width} x {height} px")
    image = np.ascontiguousarray(clean_mm, np.float32)
    small = cv2.resize(image, (width // factor, height // factor), interpolation=cv2.INTER_AREA)
    large: NDArray[Any] = cv2.resize(small, (width, height), interpolation=cv2.INTER_CUBIC)
    noisy: NDArray[np.uint16] = np.clip(np.rint(large), 0, np.iinfo(np.uint16).max).astype(
        np.uint16
    )
    return noisy


def write_resampled(dataset: Path, split: str, factor: int, mask: str, out: Path) -> list[Path]:
    """Write *_clean.png and *_noisy.png for each frame of a data set; return the files.

    Args:
        dataset: whose clean maps are taken, at their distance from the camera; its noise is not.
        split: train, val or test.
        factor: 2 or more.
        mask: dense, or as-noisy: clean maps have no depth where the noisy ones have none.
        out: folder; a sub-folder per subject.

    Raises:
        ConfigError: for a factor below 2 or above the size of the maps.
        DatasetError: the data set cannot be read, or the files cannot be written.
    """
    if factor < 2:
        raise ConfigError(f"--factor {factor}: give 2 or more")
    frames = open_frames(dataset, split, protocol="depth")
    written = []
    for number in range(len(frames)):
        key = frames.key(number)
        clean = np.rint(frames.load(number).clean_mm).astype(np.uint16)
        noisy = resampled(clean.astype(np.float32), factor)
        if mask == "as-noisy":
            clean[noisy == 0] = 0
        folder = out / key.subject
        with wrap_write_errors(folder):
            folder.mkdir(parents=True, exist_ok=True)
        for layer, depth in (("clean", clean), ("noisy", noisy)):
            path = folder / f"{key.sequence}_{key.frame:05d}_{layer}.png"
            data = encode_png(depth)
            if not (path.is_file() and path.read_bytes() == data):  # scores depend on file times
                write_atomic(data, path)
            written.append(path)
    return written
