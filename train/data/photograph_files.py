"""Files of photographs: those of a folder, or those in the wheel of scikit-image."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, DatasetError

#: The name of the photographs in the wheel of scikit-image, instead of a folder.
BUNDLED: Final = "scikit-image"
#: Those of its files that are photographs of scenes, surfaces and living things. The others are
#: drawings, text, medical images, the second view of a stereo pair, and nebulae.
_BUNDLED_FILES: Final = (
    "astronaut.png", "brick.png", "camera.png", "chelsea.png", "coffee.png", "coins.png",
    "grass.png", "gravel.png", "moon.png", "motorcycle_left.png", "rocket.jpg",
)  # fmt: skip
_SUFFIXES: Final = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")
#: Every fifth photograph is held out for validation, from this one.
_HELD_OUT_EVERY, _HELD_OUT_FROM = 5, 3
#: Only the middle of a larger photograph is kept, px: 800 of DIV2K then take 210 MB.
_KEPT_PX: Final = 512

Grey = NDArray[np.uint8]


class Photograph(NamedTuple):
    """A photograph: (H, W) grey levels, 0 to 255."""

    name: str
    grey: Grey


def find_photographs(place: str) -> list[Path]:
    """Return the image files of a folder and those below it, or those of scikit-image.

    Raises ConfigError for a folder with fewer than two, and without scikit-image.
    """
    if place != BUNDLED:
        found = sorted(f for f in Path(place).rglob("*") if f.suffix.lower() in _SUFFIXES)
        if len(found) < 2:
            raise ConfigError(f"--photos {place}: holds {len(found)} images, at least 2 are needed")
        return found
    package = importlib.util.find_spec("skimage")
    if package is None or package.origin is None:
        raise ConfigError(
            f"--photos {BUNDLED}: is not installed: pip install scikit-image, or give a folder of "
            "photographs"
        )
    return [Path(package.origin).parent / "data" / name for name in _BUNDLED_FILES]


def read_photographs(files: Sequence[Path], side: int) -> list[Photograph]:
    """Read grey photographs, cut to their middle. Raises DatasetError for one below ``side`` px."""
    photographs = []
    for file in files:
        image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise DatasetError(f"{file}: cannot be read as an image")
        if min(image.shape) < side:
            raise DatasetError(f"{file}: is smaller than {side} x {side} pixels: remove it")
        top, left = (max(0, (size - _KEPT_PX) // 2) for size in image.shape)
        grey = image[top : top + _KEPT_PX, left : left + _KEPT_PX].astype(np.uint8)
        photographs.append(Photograph(file.name, np.ascontiguousarray(grey)))
    return photographs


def split_photographs(photographs: Sequence[Photograph]) -> tuple[list[Photograph], ...]:
    """Return the photographs to train on, and those to validate on; at least one of each."""
    held = set(range(min(_HELD_OUT_FROM, len(photographs) - 1), len(photographs), _HELD_OUT_EVERY))
    parts = [p for n, p in enumerate(photographs) if n not in held]
    return parts, [photographs[n] for n in sorted(held)]
