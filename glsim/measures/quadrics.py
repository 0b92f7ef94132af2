"""Quadric fit around every pixel: residual, slope and roughness (depth in mm, NaN = none)."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from glsim.core.array_types import Array, Floats, Mask
from glsim.core.depth_map import FITTED_STEP

#: Smallest cosine of a used surface: the angle between ray and normal is at most 70 degrees.
_LEAST_COSINE = float(np.cos(np.radians(70.0)))


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Least-squares quadrics in square windows, (H, W) float32; NaN for windows without a fit.

    Attributes:
        residual_mm: depth of the centre pixel minus the quadric there.
        rough_mm: standard deviation of the residual (49 - 6 degrees of freedom in 7 x 7).
        cosine: cosine of the angle between ray and normal.
        bend_mm: sag over two pixels, the largest second derivative times (2 px)^2 / 2.
    """

    residual_mm: Floats
    rough_mm: Floats
    cosine: Floats
    bend_mm: Floats

    @property
    def smooth(self) -> Mask:
        """The windows without holes and steps that are not seen at a grazing angle, (H, W) mask."""
        return np.isfinite(self.rough_mm) & (self.cosine > _LEAST_COSINE)


@lru_cache(maxsize=4)
def quadric_basis(size: int) -> Array:
    """Compute orthonormal images of 1, x, y, x^2, xy, y^2 in size x size px, (size^2, 6)."""
    y, x = np.mgrid[:size, :size] - 0.5 * (size - 1)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1).reshape(-1, 6)
    q = np.linalg.qr(terms)[0]
    return np.asarray(q * np.sign((q * terms).sum(axis=0)))


def fit_surfaces(depth_mm: Floats, rays: Floats, size: int) -> Surfaces:
    """Fit quadrics to depth, (H, W) mm, NaN = none, in windows of odd ``size`` without steps."""
    known = np.isfinite(depth_mm)
    z = np.where(known, depth_mm, 0.0).astype(np.float64)
    limit = FITTED_STEP.limit_mm(z)
    torn = ~known
    torn[:, 1:] |= np.abs(np.diff(z, axis=1)) > limit[:, 1:]
    torn[1:] |= np.abs(np.diff(z, axis=0)) > limit[1:]
    whole = cv2.erode((~torn).astype(np.uint8), np.ones((size, size), np.uint8), borderValue=0) > 0
    offset = float(np.median(z[known])) if known.any() else 0.0
    moved = np.where(known, z - offset, 0.0)
    basis = quadric_basis(size)
    centre = basis[size * size // 2]
    kernels = [kernel.reshape(size, size) for kernel in basis.T]
    parts = [cv2.filter2D(moved, cv2.CV_64F, k, borderType=cv2.BORDER_REFLECT) for k in kernels]
    squares = cv2.boxFilter(
        moved * moved, cv2.CV_64F, (size, size), normalize=False, borderType=cv2.BORDER_REFLECT
    )
    left = squares - sum(part * part for part in parts)
    residual = moved - sum(part * value for part, value in zip(parts, centre, strict=True))
    half = size // 2
    ramp = np.arange(-half, half + 1.0)
    unit = np.sqrt(size * (ramp**2).sum())  # norm of the kernels x and y
    slope_x, slope_y = parts[1] / unit, parts[2] / unit
    bent = ramp**2 - (ramp**2).mean()
    curve = np.sqrt(size * (bent**2).sum())
    bend = 4.0 * np.maximum(np.abs(parts[3]), np.abs(parts[5])) / curve
    rough = np.sqrt(np.maximum(left, 0.0) / (size * size - 6))
    images = residual, rough, _cosine(z, slope_x, slope_y, rays), bend
    return Surfaces(*(np.where(whole, image, np.nan).astype(np.float32) for image in images))


def _cosine(z: Array, slope_x: Array, slope_y: Array, rays: Floats) -> Array:
    """Compute the cosine between ray and normal of z(u, v), from slopes in mm per pixel."""
    step_x = np.abs(np.gradient(rays[..., 0].astype(np.float64), axis=1))
    step_y = np.abs(np.gradient(rays[..., 1].astype(np.float64), axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):
        # The surface is P = z (x, y, 1), with tangents P_u = z_u (x, y, 1) + z (dx, 0, 0), and P_v
        # likewise. Their cross product over z dx dy is (-z_u / dx, -z_v / dy, z + x z_u / dx + y
        # z_v / dy). Its product with the ray (x, y, 1) is z.
        gx, gy = slope_x / step_x, slope_y / step_y
        normal_z = z + gx * rays[..., 0] + gy * rays[..., 1]
        length = np.sqrt(gx**2 + gy**2 + normal_z**2)
        ray = np.sqrt(1.0 + (rays.astype(np.float64) ** 2).sum(axis=-1))
        return np.asarray(z / (length * ray))


def local_planes(values: Array, known: Mask, window: Array) -> tuple[Array, Array, Array]:
    """Fit a plane to the known values around every pixel.

    ``values`` and ``known`` are (H, W). ``window`` holds (2 n + 1,) weights along rows and along
    columns. Returns the plane at its centre pixel, the standard deviation of the values from it,
    and the known share of the weights, (H, W) each.
    """
    away = np.arange(len(window)) - len(window) // 2
    powers = [window / window.sum() * away**power for power in range(3)]
    offset = float(values[known].mean())
    ones, d = known.astype(np.float64), np.where(known, values - offset, 0.0)

    def moment(image: Array, x: int, y: int) -> Array:
        border = cv2.BORDER_CONSTANT
        total = cv2.sepFilter2D(image, cv2.CV_64F, powers[x], powers[y], borderType=border)
        return np.asarray(total, np.float64) / weight

    weight: Array = np.ones(values.shape)
    weight = np.maximum(moment(ones, 0, 0), 1e-12)
    mean_x, mean_y, mean = moment(ones, 1, 0), moment(ones, 0, 1), moment(d, 0, 0)
    xx, yy = moment(ones, 2, 0) - mean_x**2 + 0.05, moment(ones, 0, 2) - mean_y**2 + 0.05
    xy = moment(ones, 1, 1) - mean_x * mean_y
    xd, yd = moment(d, 1, 0) - mean_x * mean, moment(d, 0, 1) - mean_y * mean
    scale = np.maximum(xx * yy - xy * xy, 1e-9)
    slope_x, slope_y = (xd * yy - yd * xy) / scale, (yd * xx - xd * xy) / scale
    square = moment(d * d, 0, 0) - mean * mean - slope_x * xd - slope_y * yd
    plane = offset + mean - slope_x * mean_x - slope_y * mean_y
    return plane, np.sqrt(np.maximum(square, 0.0)), weight
