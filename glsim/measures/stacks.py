"""Measures of stacks of frames of one static scene: (T, H, W) float64 mm, NaN = no depth.

A residual is the measured depth of the frames minus the true depth.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array, Mask, Reals
from glsim.core.depth_map import central_normals
from glsim.measures.correlation import correlation_of, lagged_sums


def with_nan(depth_mm: NDArray[np.generic]) -> Array:
    """Convert depths to float64 and replace missing depth (0) by NaN."""
    depth = np.array(depth_mm, np.float64)
    depth[depth <= 0] = np.nan
    return depth


def jackknife_error(without: Sequence[Any] | Array) -> Array:
    """Compute the standard error of figures from figures without each of K parts, (K, ...)."""
    values = np.asarray(without, np.float64)
    return np.asarray(np.sqrt((len(values) - 1) * values.var(axis=0)))


def without_plane(frames: Array) -> Array:
    """Subtract from each frame the least-squares plane of its valid pixels."""
    height, width = frames.shape[-2:]
    rows, columns = np.mgrid[:height, :width]
    design = np.stack([np.ones(rows.size), rows.ravel(), columns.ravel()], axis=1)
    design[:, 1:] -= design[:, 1:].mean(axis=0)
    images = frames.reshape(-1, height * width)
    out = np.full(images.shape, np.nan)
    valid = np.isfinite(images)
    whole = valid.all(axis=1)
    out[whole] = images[whole] - images[whole] @ np.linalg.pinv(design).T @ design.T
    for number in np.flatnonzero(~whole & (valid.sum(axis=1) > 3)):
        own = valid[number]
        fit = np.linalg.lstsq(design[own], images[number, own], rcond=None)[0]
        out[number, own] = images[number, own] - design[own] @ fit
    return out.reshape(frames.shape)


def sigma_spatial(residual: Array) -> float:
    """Compute sigma_S: standard deviation of a frame about its best plane, rms over frames."""
    flat = without_plane(residual)
    valid = np.isfinite(flat)
    return float(np.sqrt((flat[valid] ** 2).mean())) if valid.any() else float("nan")


def temporal_part(frames: Array) -> Array:
    """Subtract each pixel's mean over time, scaled to unbiased variance; NaN below two frames."""
    count = np.isfinite(frames).sum(axis=0)
    mean = np.where(count > 1, np.nansum(frames, axis=0) / np.maximum(count, 1), np.nan)
    return np.asarray((frames - mean) * np.sqrt(count / np.maximum(count - 1, 1)))


def moments(frames: Sequence[Reals] | Array) -> tuple[Array, Array, Array]:
    """Compute each pixel's number of valid frames, mean and unbiased variance, (H, W), 0 = none."""
    count = np.zeros(frames[0].shape)
    total, squares = np.zeros(count.shape), np.zeros(count.shape)
    for frame in frames:
        count += np.isfinite(frame)
        total += np.nan_to_num(frame)
    mean = total / np.maximum(count, 1)
    for frame in frames:
        squares += np.where(np.isfinite(frame), (frame - mean) ** 2, 0.0)
    return count, mean, squares / np.maximum(count - 1, 1)


def variance_temporal_map(frames: Array) -> Array:
    """Compute the (H, W) unbiased variance of each pixel over time; NaN below two valid frames."""
    count, _, variance = moments(frames)
    return np.where(count > 1, variance, np.nan)


def sigma_temporal_map(frames: Array) -> Array:
    """Compute the (H, W) standard deviation of each pixel over time; NaN below two valid frames.

    It is unbiased for Gaussian noise: the root of the unbiased variance of n samples is on average
    (4n - 4) / (4n - 3) times the standard deviation.
    """
    count = np.maximum(np.isfinite(frames).sum(axis=0), 2)
    return np.asarray(np.sqrt(variance_temporal_map(frames)) * (4 * count - 3) / (4 * count - 4))


def sigma_temporal(frames: Array) -> float:
    """Compute sigma_T: standard deviation of a pixel over time, averaged over the pixels."""
    return mean_of(sigma_temporal_map(frames))


def mean_of(values: Array) -> float:
    """Average the finite values; NaN if there are none."""
    valid = values[np.isfinite(values)]
    return float(valid.mean()) if valid.size else float("nan")


def ratio(first: float, second: float) -> float:
    """Divide first by second; NaN if second is 0 or either value is not finite."""
    return first / second if second != 0 and np.isfinite([first, second]).all() else float("nan")


def fixed_pattern(frames: Array) -> tuple[Array, float]:
    """Compute each pixel's mean minus the best plane, (H, W), and its standard deviation."""
    # The mean of T frames still has temporal noise; its variance is subtracted.
    count = np.isfinite(frames).sum(axis=0)
    mean = np.where(count > 0, np.nansum(frames, axis=0) / np.maximum(count, 1), np.nan)
    pattern = without_plane(mean)
    noise = mean_of(variance_temporal_map(frames) / np.maximum(count, 1))
    return pattern, float(np.sqrt(max(mean_of(pattern**2) - noise, 0.0)))


def autocorrelation(part: Array, lags: Sequence[tuple[int, int]]) -> Array:
    """Compute the (L,) correlation of images of mean 0, over mirrored lags and swapped axes."""
    return np.array(correlation_of([lagged_sums(part, lags, both_axes=True)]))


def temporal_autocorrelation(frames: Array) -> float:
    """Compute the correlation of a pixel with its value one frame later, without fixed pattern."""
    # Without the mean of T frames, white noise is anticorrelated by 1 / (T - 1), which is added.
    part = temporal_part(frames)
    return ratio(mean_of(part[1:] * part[:-1]), mean_of(part**2)) + 1.0 / (len(frames) - 1)


def skew_kurtosis(samples: Array) -> tuple[float, float]:
    """Compute skewness and excess kurtosis; both are 0 for Gaussian noise."""
    x = samples[np.isfinite(samples)]
    if x.size < 2 or x.std() == 0:
        return float("nan"), float("nan")
    x = (x - x.mean()) / x.std()
    return float((x**3).mean()), float((x**4).mean() - 3.0)


def edge_positions(frames: Array, near_mm: float, far_mm: float) -> Array:
    """Count the pixels of the left foreground per row, (T, H): nearer than half the step."""
    foreground = np.nan_to_num(frames, nan=np.inf) < 0.5 * (near_mm + far_mm)
    return np.asarray(foreground.sum(axis=2), np.float64)


def edge_jitter(positions: Array) -> float:
    """Compute the standard deviation, px, of edge positions (T, H) about the best line."""
    rows = np.arange(positions.shape[1])
    line = np.polynomial.Polynomial.fit(rows, positions.mean(axis=0), 1)
    return float((positions - line(rows)).std())


def mixed_per_row(frames: Array, near_mm: float, far_mm: float) -> tuple[float, float, float]:
    """Count pixels per row: between two surfaces, 20 mm from both; outside both; without depth."""
    between = (frames > near_mm + 20) & (frames < far_mm - 20)
    outside = (frames < near_mm - 20) | (frames > far_mm + 20)
    rows = frames.shape[0] * frames.shape[1]
    counts = [float(m.sum()) / rows for m in (between, outside, np.isnan(frames))]
    return counts[0], counts[1], counts[2]


def sinusoids(
    z_mm: Array, error_mm: Array, periods_mm: Sequence[float]
) -> tuple[Array, Array, float]:
    """Fit offset, linear trend and one sinusoid per period jointly by least squares.

    Returns the amplitudes and their standard errors, (len(periods),), and the residual's rms, mm.
    """
    at = 2 * np.pi * z_mm[:, None] / np.asarray(periods_mm, np.float64)
    span = (z_mm - z_mm.mean()) / np.ptp(z_mm)
    design = np.column_stack([np.ones_like(span), span, np.cos(at), np.sin(at)])
    fit = np.linalg.lstsq(design, error_mm, rcond=None)[0]
    residual = error_mm - design @ fit
    spare = max(len(z_mm) - design.shape[1], 1)
    covariance = np.linalg.pinv(design.T @ design) * (residual @ residual / spare)
    n = len(periods_mm)
    amplitude = np.hypot(fit[2 : 2 + n], fit[2 + n :])
    error = np.sqrt(np.maximum(np.diag(covariance)[2 : 2 + n], np.diag(covariance)[2 + n :]))
    return amplitude, error, float(np.sqrt((residual**2).mean()))


def without_trend(z_mm: Array, error_mm: Array) -> Array:
    """Subtract mean and linear trend from errors; all NaN if an error is not finite."""
    if not np.isfinite(error_mm).all():
        return np.full(error_mm.shape, np.nan)
    return np.asarray(error_mm - np.polynomial.Polynomial.fit(z_mm, error_mm, 1)(z_mm))


def crossing(x: Array, share: Array, level: float) -> float:
    """Interpolate the x from which rising shares stay at or above ``level``; NaN if they do not."""
    below = np.flatnonzero(share < level)
    if len(below) == 0 or below[-1] + 1 >= len(x):
        return float("nan")
    i = below[-1]
    t = (level - share[i]) / (share[i + 1] - share[i])
    return float(x[i] + t * (x[i + 1] - x[i]))


def half_valid(level: Reals, valid: Mask, edges: Reals) -> float:
    """Interpolate the level at which half of the pixels of a bin are valid; NaN if none is."""
    place = np.digitize(level, edges)
    used = [k for k in range(1, len(edges)) if (place == k).any()]
    means, shares = (np.array([part[place == k].mean() for k in used]) for part in (level, valid))
    return crossing(means, shares, 0.5)


def normals(depth_mm: Array, rays: Reals) -> Array:
    """Compute (H, W, 3) unit normals by central differences; NaN if a neighbour has no depth.

    ``rays`` are (H, W, 2) x/z and y/z of the pixels.
    """
    inner = np.zeros(depth_mm.shape, np.bool_)
    inner[1:-1, 1:-1] = True
    normal = np.full((*depth_mm.shape, 3), np.nan)
    normal[inner] = central_normals(depth_mm, rays, inner)
    return np.asarray(normal / np.linalg.norm(normal, axis=-1, keepdims=True))


def angular_error_deg(first: Array, second: Array) -> float:
    """Compute the mean angle, degrees, between two unit normal fields where both are known."""
    return mean_of(np.degrees(np.arccos(np.clip((first * second).sum(axis=-1), -1.0, 1.0))))


def eroded(mask: Mask, steps: int) -> Mask:
    """Erode a mask by ``steps`` pixels (8 neighbours); pixels outside the image count as unset."""
    kernel = np.ones((2 * steps + 1,) * 2, np.uint8)
    return np.asarray(cv2.erode(mask.astype(np.uint8), kernel, borderValue=0) > 0)


def steps_mm(depth_mm: Array) -> Array:
    """Compute each pixel's largest difference to its 8 neighbours, (H, W) mm, ignoring NaN."""
    kernel = np.ones((3, 3), np.uint8)
    high = cv2.dilate(np.nan_to_num(depth_mm, nan=-np.inf), kernel, borderValue=-np.inf)
    low = cv2.erode(np.nan_to_num(depth_mm, nan=np.inf), kernel, borderValue=np.inf)
    return np.asarray(np.nan_to_num(np.maximum(high - depth_mm, depth_mm - low)))


def longest_run(mask: Mask) -> int:
    """Return the length of the longest run of set pixels along a row."""
    best = current = np.zeros(mask.shape[0], np.int64)
    for column in range(mask.shape[1]):
        current = np.where(mask[:, column], current + 1, 0)
        best = np.maximum(best, current)
    return int(best.max(initial=0))
