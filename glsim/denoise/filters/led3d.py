"""The clean-up of face maps of Mu et al.: outliers, the largest piece, holes inside it.

G. Mu, D. Huang, G. Hu, J. Sun, Y. Wang, "Led3D: A Lightweight and Efficient Deep Approach to
Recognizing Low-Quality 3D Faces", CVPR 2019, prepare Kinect V2 maps for a recognition network in
this way. Taken here: removal of statistical outliers (their tool is that of point clouds: Rusu et
al., "Towards 3D Point Cloud Based Object Maps for Household Environments", 2008), a median, the
largest connected piece, and filling of the holes that it encloses. Left out, because the result
must stay a depth map of the same pixels: the crop of 100 mm around the tip of the nose, the doubled
resolution, the rounding to 256 levels, and a 3x3 maximum around filled holes, which would shift
depth to the camera.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from glsim.core.errors import ConfigError
from glsim.denoise.filters.windows import around, fill, pieces
from glsim.denoise.interface import Denoised, Depth, Mask, parameter

#: Neighbours that an outlier is compared with; the default of the authors' tool.
_NEIGHBOURS = 4
#: Half side of the square around a filled hole in which depth is smoothed, px (theirs is 9 x 9).
_SMOOTHED_PX = 4


@dataclass(frozen=True)
class Led3DCleanUp:
    """Removal of outliers, median, largest piece and hole filling after Mu et al. (Led3D 2019)."""

    deviations: float = parameter(
        1.0, 0.1, 20, "a pixel this many standard deviations farther from its neighbours goes"
    )
    size: int = parameter(3, 3, 5, "side of the median's window, px: 3 or 5")

    def __post_init__(self) -> None:
        if self.size not in (3, 5):
            raise ConfigError("--denoiser led3d: OpenCV's median of float depth has size 3 or 5")

    def __call__(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """Clean (H, W) millimetres; the output has the mask of one piece without inner holes."""
        kept = largest_piece(noisy_mm, valid & ~outliers(noisy_mm, valid, self.deviations))
        if not kept.any():
            return Denoised(np.zeros_like(noisy_mm), kept)
        median = cv2.medianBlur(fill(noisy_mm, kept), self.size)
        holes = enclosed_holes(kept)
        depth = np.where(kept, median, np.float32(0))
        filled = _with_filled_holes(depth, holes)
        zone = cv2.dilate(holes.astype(np.uint8), np.ones((2 * _SMOOTHED_PX + 1,) * 2, np.uint8))
        whole = kept | holes
        smooth = cv2.medianBlur(fill(filled, whole), self.size)
        result = np.where(whole & (zone > 0), smooth, filled)
        return Denoised(np.where(whole, result, np.float32(0)), whole)


def outliers(depth_mm: Depth, valid: Mask, deviations: float) -> Mask:
    """Mark valid pixels whose mean distance to their four nearest neighbours is unusually large.

    The neighbours are those of the pixel grid, in depth: valid pixels of 3 x 3 px. Unusual is a
    mean distance above the frame's mean plus ``deviations`` standard deviations. A pixel without
    neighbours is an outlier. depth_mm, valid: (H, W).
    """
    result = np.zeros_like(valid)
    if not valid.any():
        return result
    values = np.where(valid, depth_mm, np.float32(np.nan))
    near = around(values, 1, valid, np.nan)
    own = near[:, near.shape[1] // 2, None]
    distances = np.abs(np.delete(near, near.shape[1] // 2, axis=1) - own)
    nearest = np.sort(distances, axis=1)[:, :_NEIGHBOURS]  # NaN last
    known = np.isfinite(nearest)
    count = known.sum(axis=1)
    mean = np.where(known, nearest, 0).sum(axis=1) / np.maximum(count, 1)
    if count.any():
        some = mean[count > 0]
        limit = some.mean() + deviations * some.std()
        result[valid] = (count == 0) | (mean > limit)
    else:
        result[valid] = True
    return result


def largest_piece(depth_mm: Depth, valid: Mask) -> Mask:
    """Return the (H, W) pixels of the largest surface of ``pieces``.

    The first one in reading order if several are the largest.
    """
    labels = pieces(depth_mm, valid)
    areas = np.bincount(labels.ravel())
    areas[0] = 0
    largest: Mask = valid & (labels == areas.argmax())
    return largest


def enclosed_holes(mask: Mask) -> Mask:
    """Mark the (H, W) pixels outside the mask that are not connected to the image's border."""
    outside = np.pad(~mask, 1, constant_values=True).astype(np.uint8)
    _, labels = cv2.connectedComponents(outside, connectivity=4)
    holes: Mask = (~mask) & (labels[1:-1, 1:-1] != labels[0, 0])
    return holes


def _with_filled_holes(depth: Depth, holes: Mask) -> Depth:
    """Fill each enclosed hole with the farthest depth on its rim, as a flooded basin."""
    _, labels = cv2.connectedComponents(holes.astype(np.uint8), connectivity=4)
    farthest = np.zeros(int(labels.max()) + 1, np.float32)
    grown = cv2.dilate(holes.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    rows, columns = np.nonzero(grown & ~holes)
    padded = np.pad(np.asarray(labels, np.intp), 1)
    for down in range(3):
        for right in range(3):
            touched = padded[rows + down, columns + right]
            np.maximum.at(farthest, touched, depth[rows, columns])
    return np.where(holes, farthest[labels], depth)


#: Name on the command line -> filter.
FILTERS = {"led3d": Led3DCleanUp}
