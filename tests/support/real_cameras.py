"""Recordings of real depth cameras beside the repository, and simulated disparity noise."""

import os
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.files.png import decode_png
from glsim.measures.disparity import to_disparity

Array = NDArray[np.float64]

#: One frame to 40 frames of each camera; their folders say where they come from.
REAL_CAMERAS = Path(__file__).resolve().parents[3] / "shared" / "data" / "real-cameras"
needs_real_cameras = pytest.mark.skipif(
    not REAL_CAMERAS.is_dir(), reason=f"no recordings of real cameras in {REAL_CAMERAS}"
)
#: 44 frames of a real Kinect V2; GLSIM_REAL_FRAMES names another place.
REAL_KINECT_V2 = Path(os.environ.get("GLSIM_REAL_FRAMES", REAL_CAMERAS.with_name("kinect-v2-real")))
needs_real_kinect_v2 = pytest.mark.skipif(
    not REAL_KINECT_V2.is_dir(), reason=f"no frames in {REAL_KINECT_V2} (GLSIM_REAL_FRAMES)"
)
#: Focal length times baseline, px mm, by the lattices of the depths.
D435_WALL_PX_MM, D435_ROBOT_PX_MM = 626_823 / 32, 612_342 / 32
#: Side of the tiles that the tests expect.
SIDE_PX = 40


def real_depths(folder: str, unit_mm: float = 1.0, most: int | None = None) -> list[Array]:
    """Read the depth maps of a folder, mm; 0 where there is no depth or the file clips."""
    depths = []
    for file in sorted((REAL_CAMERAS / folder).glob("depth*.png"))[:most]:
        image = decode_png(file.read_bytes(), 1 << 21)
        assert image is not None, file
        depth = image.astype(np.float64)
        depths.append(np.where(depth < 65535, depth, 0.0) * unit_mm)
    return depths


def real_disparities(folder: str, focal_baseline_px_mm: float) -> list[Array]:
    """Read the depth maps of a folder as disparity, px."""
    return [to_disparity(depth, focal_baseline_px_mm) for depth in real_depths(folder)]


def box_noise(
    rng: np.random.Generator, frames: int, shape: tuple[int, int], box_px: int, sigma: float
) -> Array:
    """Draw (T, H, W) white noise averaged over boxes, of standard deviation ``sigma``."""
    height, width = shape
    white = rng.normal(size=(frames, height + box_px - 1, width + box_px - 1))
    sums = np.zeros((frames, height, width))
    for down in range(box_px):
        for right in range(box_px):
            sums += white[:, down : down + height, right : right + width]
    return sums * (sigma / box_px)


def box_covariance(side_px: int, box_px: int) -> Array:
    """Compute the covariance (P, P) of a tile of ``box_noise`` minus its fitted plane."""
    y, x = (part.ravel() for part in np.mgrid[:side_px, :side_px])
    share = [np.clip(1 - np.abs(v[:, None] - v) / box_px, 0, 1) for v in (y, x)]
    covariance = share[0] * share[1]
    design = np.stack([np.ones(x.size), x, y], axis=1)
    q = np.linalg.qr(design)[0]
    covariance = covariance - q @ (q.T @ covariance)
    return np.asarray(covariance - (covariance @ q) @ q.T)
