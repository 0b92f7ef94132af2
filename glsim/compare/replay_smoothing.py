"""Remove the noise of a depth map by local planes in inverse depth, in which planes are planes."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Step between slabs of the smoothing, share of the depth (a plane is fitted to three of them), and
#: least share of a window that has depth in its slab. Chosen: a rail of 5 px has half.
_SLAB, _LEAST_NEIGHBOURS = 0.06, 0.2


def smooth_depth(depth_mm: NDArray[np.float32], known: NDArray[np.bool_], sigma_px: float) -> Array:
    """Smooth a depth map within slabs of depth.

    A plane is fitted to the pixels of a slab of depths alone, so that a near and a far surface that
    touch elsewhere are not mixed.

    Args:
        depth_mm: (H, W) mm.
        known: (H, W) pixels that are used.
        sigma_px: standard deviation of the Gaussian window, px.

    Returns:
        (H, W) mm; NaN where nothing is known, and for flying pixels, which have few neighbours in
        their slab.

    """
    if not known.any():
        return np.full(depth_mm.shape, np.nan)
    level = np.where(known, np.log(np.where(known, depth_mm, 1.0)) / _SLAB, -10.0)
    lower = np.floor(level)
    above = level - lower  # share of the slab above, for a smooth change from slab to slab
    total, weight = np.zeros(depth_mm.shape), np.zeros(depth_mm.shape)
    pad = int(np.ceil(3 * sigma_px))
    for centre in range(int(lower[known].min()), int(lower[known].max()) + 2):
        share = np.where(lower == centre, 1.0 - above, np.where(lower == centre - 1, above, 0.0))
        mask = np.abs(level - centre) < 1.5
        if not share.any():
            continue
        rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
        part = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        inside = mask[part]
        d = np.where(inside, 1000.0 / np.where(inside, depth_mm[part], 1.0), 0.0)
        fitted, near = _local_planes(np.pad(d, pad), np.pad(inside, pad) * 1.0, sigma_px)
        inner = np.s_[pad : pad + inside.shape[0], pad : pad + inside.shape[1]]
        dense = share[part] * (near[inner] > _LEAST_NEIGHBOURS)
        total[part] += dense * fitted[inner]
        weight[part] += dense
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(weight > 0.5, 1000.0 * weight / total, np.nan)


def _local_planes(values: Array, mask: Array, sigma_px: float) -> tuple[Array, Array]:
    """Fit a plane around every pixel, weighted by a Gaussian and a mask.

    Returns:
        Its value at the pixel, and the share of the window that the mask has.
    """
    y, x = np.mgrid[: values.shape[0], : values.shape[1]].astype(np.float64)
    known = mask > 0
    offset = float(values[known].mean())
    d = np.where(known, values - offset, 0.0)

    def blur(image: Array) -> Array:
        return np.asarray(cv2.GaussianBlur(image, (0, 0), sigma_px, borderType=cv2.BORDER_CONSTANT))

    weight = np.maximum(blur(mask), 1e-12)
    mean_x, mean_y, mean = (blur(mask * v) / weight for v in (x, y, d))
    xx = blur(mask * x * x) / weight - mean_x**2 + 0.05
    yy = blur(mask * y * y) / weight - mean_y**2 + 0.05
    xy = blur(mask * x * y) / weight - mean_x * mean_y
    xd = blur(mask * x * d) / weight - mean_x * mean
    yd = blur(mask * y * d) / weight - mean_y * mean
    scale = np.maximum(xx * yy - xy * xy, 1e-9)
    slope_x, slope_y = (xd * yy - yd * xy) / scale, (yd * xx - xd * xy) / scale
    value = offset + mean + slope_x * (x - mean_x) + slope_y * (y - mean_y)
    return np.asarray(value), weight
