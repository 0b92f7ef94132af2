"""Depth maps for the tests of ``glsim.eval``: noisy surfaces and adversarial inputs."""

import csv
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Intrinsics

Array = NDArray[np.float32]
SIZE = (40, 48)
CAMERA = Intrinsics(SIZE[1], SIZE[0], 365.0, 365.0, SIZE[1] / 2, SIZE[0] / 2)


def dome(shape: tuple[int, int] = SIZE, whole: bool = True) -> Array:
    """Compute a paraboloid in the image centre, 900 mm at its tip, with background 0."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    r2 = ((y - shape[0] / 2) / shape[0]) ** 2 + ((x - shape[1] / 2) / shape[1]) ** 2
    depth = np.where(r2 < 0.16, 900 + 300 * r2, 0)
    return (np.rint(depth) if whole else depth).astype(np.float32)


def noisy(clean: Array, seed: int = 0, sigma_mm: float = 3.0) -> Array:
    """Add axial noise, holes, and some false depth beside the silhouette."""
    rng = np.random.default_rng(seed)
    depth = np.where(clean > 0, np.rint(clean + rng.normal(0, sigma_mm, clean.shape)), 0)
    depth[rng.random(clean.shape) < 0.05] = 0
    grown = (rng.random(clean.shape) < 0.02) & (clean == 0)
    depth[grown] = np.rint(rng.uniform(500, 1200, clean.shape))[grown]
    return depth.astype(np.float32)


def _adversarial() -> dict[str, tuple[Array, Array, Array]]:
    """Return difficult cases: name -> prediction, clean, noisy."""
    zero, clean = np.zeros(SIZE, np.float32), dome()
    dot, other = zero.copy(), zero.copy()
    dot[20, 20], other[5, 7] = 900, 700
    offset: Array = np.where(clean > 0, np.float32(0.3), np.float32(0))
    moved_dot: Array = np.where(dot > 0, dot + np.float32(3), dot)
    left, right = dome(), dome()
    left[:, 20:], right[:, :20] = 0, 0
    stairs = np.where(np.arange(SIZE[1]) < 20, 900, 1500).astype(np.float32) * np.ones(
        (SIZE[0], 1), np.float32
    )
    return {
        "random": (noisy(clean, 1), clean, noisy(clean, 2)),
        "fine": (noisy(clean, 1) + offset, dome(whole=False), noisy(clean)),
        "equal": (clean, clean, clean),
        "all zero": (zero, zero, zero),
        "prediction empty": (zero, clean, noisy(clean)),
        "clean empty": (noisy(clean), zero, noisy(clean)),
        "input empty": (noisy(clean), clean, zero),
        "one pixel": (dot, moved_dot, dot),
        "one pixel each": (dot, other, clean),
        "no overlap": (left, right, clean),
        "steps": (noisy(stairs), stairs, noisy(stairs, 3)),
        "huge": (np.full(SIZE, 65535, np.float32), np.full(SIZE, 1, np.float32), clean),
    }


ADVERSARIAL = _adversarial()


def write_pairs(folder: Path, subjects: int = 3, frames: int = 4) -> Path:
    for subject in range(subjects):
        place = folder / f"p{subject}"
        place.mkdir(parents=True, exist_ok=True)
        for frame in range(frames):
            clean = np.roll(dome(), 2 * subject + frame, axis=1)
            seen = noisy(clean, 10 * subject + frame)
            cv2.imwrite(str(place / f"s_{frame:03d}_clean.png"), clean.astype(np.uint16))
            cv2.imwrite(str(place / f"s_{frame:03d}_noisy.png"), seen.astype(np.uint16))
    return folder


def rows(out: Path) -> list[dict[str, str]]:
    with (out / "rows.csv").open() as file:
        return list(csv.DictReader(file))
