"""Correlation of noise between pixels of an image."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import cv2
import numpy as np

from glsim.core.array_types import Array

#: Lags of the tables, (rows down, columns right).
LAGS = ((0, 1), (0, 2), (0, 3), (1, 0), (2, 0), (3, 0), (1, 1))


def lagged_sums(
    images: Array, lags: Sequence[tuple[int, int]] = LAGS, *, both_axes: bool = False
) -> Array:
    """Sum, at each lag, the products of pixels and the squares of the same pixels, (..., L, 2).

    Their ratio is the correlation, see ``correlation_of``. Images are (..., H, W) noise of mean 0,
    NaN = unknown. Lags are (rows, columns) >= 0. A diagonal lag is averaged with its mirror image.
    With ``both_axes`` each lag is averaged with the lag of swapped rows and columns.
    """
    sums = np.zeros((*images.shape[:-2], len(lags), 2))
    for number, (down, right) in enumerate(lags):
        ways = {(down, right), (right, down)} if both_axes else {(down, right)}
        ways |= {(a, -b) for a, b in ways if a and b}
        for way in sorted(ways):
            first, second = _shifted(images, *way)
            products = first * second
            squares = 0.5 * (first**2 + second**2) + 0.0 * products  # NaN where a factor is NaN
            sums[..., number, 0] += np.nansum(products, axis=(-2, -1))
            sums[..., number, 1] += np.nansum(squares, axis=(-2, -1))
    return sums


def _shifted(images: Array, down: int, right: int) -> tuple[Array, Array]:
    height, width = images.shape[-2:]
    first = images[..., : max(height - down, 0), max(0, -right) : max(width - max(0, right), 0)]
    return first, images[..., down:, max(0, right) : width + min(0, right)]


def correlation_of(sums: Iterable[Array]) -> tuple[float, ...]:
    """Compute the correlation at each lag from sums, (..., L, 2); NaN without pixels."""
    parts = [s.reshape(-1, *s.shape[-2:]).sum(axis=0) for s in sums]
    total = np.sum(parts, axis=0) if parts else np.zeros((len(LAGS), 2))
    return tuple(float(p / s) if s > 0 else float("nan") for p, s in total)


def without_local_mean(noise: Array) -> Array:
    """Subtract the mean of the known pixels in a 31 x 31 window, to remove slow drift."""
    known, border = np.isfinite(noise), cv2.BORDER_CONSTANT
    total, count = (
        cv2.boxFilter(image, cv2.CV_64F, (31, 31), normalize=False, borderType=border)
        for image in (np.where(known, noise, 0.0), known.astype(np.float64))
    )
    return np.where(known, noise - total / np.maximum(count, 1.0), np.nan)
