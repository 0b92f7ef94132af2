"""Input features of the mask-aware networks: local, in a network's range, without codes for holes.

Each feature depends on a neighbourhood of its pixel only: a crop has the same features as within
its frame, and a wall behind a face does not change those of the face.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import reduce
from typing import Final, NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from glsim.train.models.gaussian import TINY, blurred, shrunk_mean, weighted_mean

#: Filters of `depth_features`: a robust mean, four guided filters and two that keep curves.
FILTERS: Final = 7
#: Channels of `depth_features`; the last one is validity.
CHANNELS: Final = FILTERS + 5

#: Hole filling from the rim: number of rounds, radius and sigma of the Gaussian, px. Three rounds
#: of 9x9 close holes 24 px wide, more than any speckle of drop-outs.
_FILL_ROUNDS, _FILL_RADIUS, _FILL_SIGMA = 3, 4, 1.5
#: Radius and sigma of the neighbourhood that a pixel's depth is compared with, px: wider than a
#: nose at 0.9 m (35 mm are 14 px at a focal length of 365 px).
_AROUND_RADIUS, _AROUND_SIGMA = 24, 12.0
#: Depths that differ by more than this are two surfaces: a flying pixel's error in the evaluation.
_SURFACE_MM: Final = 50.0
#: 5x5 samples 3 px apart, 6 px to each side, show the surfaces around a pixel.
_TAPS, _TAP_STEP = 2, 3
#: Radii, px, and epsilon, mm, of the guided filters: epsilon is that of the filter which removes
#: most of the noise of real Kinect V2 frames (docs/real_frames_tables.md).
_GUIDED_RADII, _GUIDED_MM = (1, 2, 4), 15.0
#: Standard deviations, px, of the Gaussians of `_curved`: under white noise they have the least
#: error on training frames of 640 and 1024 px; under correlated noise narrower filters have.
_CURVED_SIGMAS: Final = (3.0, 5.0)
#: Radius of these Gaussians in standard deviations: 10 px at most, while pixels of two surfaces
#: that are away from the step between them are 11 px apart.
_CURVED_REACH: Final = 2.0
#: Number of means in a row: each one brings back what the means before it took from the surface.
_CURVED_ROUNDS: Final = 3
#: Subtracted from depth before it is squared, mm: keeps float32 exact to 1 mm2 up to 4.5 m.
_MIDDLE_MM: Final = 1000.0
#: 3x3 samples this far apart, px, tell how much of the neighbourhood is the own surface.
_SUPPORT_STEP: Final = 6
#: Share of them beyond which a pixel is away from steps and holes: a straight rim up to 5 px away
#: leaves 2 / 3.
_EVEN_SUPPORT: Final = 0.75
#: Noise is the difference of a pixel to the mean of four others at these distances, px. White noise
#: has the same at both; noise that a filter made smooth over 3x3 pixels has more at the second.
_NOISE_STEPS_PX: Final = (1, 3)
#: Radius and sigma of the neighbourhood over which it is averaged, px.
_NOISE_RADIUS, _NOISE_SIGMA = 12, 6.0
#: Added to it before the logarithm, mm: less than rounding to whole millimetres gives.
_LEAST_NOISE_MM: Final = 0.1
#: Scales of what filters add and of the surrounding depth. On the interior of training frames, the
#: bands have standard deviations of 0.4 to 1.8 mm (median over frames).
_BAND_MM, _AROUND_MM = 2.0, 20.0


class Features(NamedTuple):
    """Features of a batch of frames; each float32 with H and W of the frames.

    fill_mm: (B, 1, H, W) depth; holes near measured pixels are filled, far ones are 0.
    bands_mm: (B, FILTERS, H, W) what filters that keep steps would add, at most 50 mm, each less
        the one before, so that their sum is what the last one adds. In order:
        guided filter with a radius of 1 px, robust mean of 5x5 px, guided filter of 2 px, Gaussian
        of 3 px that keeps curves, guided filter of 4 px, Gaussian of 5 px that keeps curves,
        guided filter of 4 px of the depth relative to all depth around (it smooths slopes as well)
    even: (B, 1, H, W), 1 on measured pixels away from steps and holes, else 0.
    channels: (B, CHANNELS, H, W), about -5 to 5, 0 where nothing is known:
        0 to 6 asinh(bands_mm / 2 mm): small at a step of any height
        7 share of the neighbourhood on the own surface, 0-1: near 0 for a flying pixel
        8 depth relative to all depth around, asinh(mm / 20): which side of a step is in front
        9, 10 log of the size of the noise around, in mm, of pixels 1 and 3 px apart
        11 validity, 0 or 1

    Bands, unlike the filters themselves, are little correlated (condition number of 80 in place of
    1,000 on training frames). With five filters as features, not as bands, 2,600 steps left their
    weights where the first 100 had brought them; a fixed sum of the same filters had a lower error.

    Depth enters by differences only. A network that sees the distance learns the noise and the
    wiggling over distance of the cameras in its training, and bends the depth of any other one.
    """

    fill_mm: Tensor
    bands_mm: Tensor
    channels: Tensor
    even: Tensor


def depth_features(noisy_mm: Tensor) -> Features:
    """Features of (B, 1, H, W) millimetres; a pixel not above 0, or not a number, is a hole."""
    measured = noisy_mm > 0
    valid = measured.to(noisy_mm.dtype)
    depth_mm = torch.where(measured, noisy_mm, 0.0)
    around_mm, near = weighted_mean(depth_mm, valid, _AROUND_RADIUS, _AROUND_SIGMA)
    fill_mm = _filled(depth_mm, valid)
    fill_mm = torch.where(fill_mm > 0, fill_mm, around_mm)
    middle_mm = torch.full_like(fill_mm, _MIDDLE_MM)
    support = _support(fill_mm, depth_mm, valid)
    even = valid * (support > _EVEN_SUPPORT)
    guided_1, guided_2, guided_4 = (
        _guided(depth_mm, valid, fill_mm, middle_mm, radius) for radius in _GUIDED_RADII
    )
    curved_3, curved_5 = (_curved(depth_mm, even, guided_2, sigma) for sigma in _CURVED_SIGMAS)
    robust = _robust_mean(fill_mm, depth_mm, valid)
    slopes = _guided(depth_mm, valid, fill_mm, around_mm, _GUIDED_RADII[-1])
    filters = [guided_1, robust, guided_2, curved_3, guided_4, curved_5, slopes]
    smoothed = torch.cat(filters, dim=1)
    filtered_mm = (smoothed - fill_mm).clamp(-_SURFACE_MM, _SURFACE_MM)
    bands_mm = torch.cat([filtered_mm[:, :1], filtered_mm[:, 1:] - filtered_mm[:, :-1]], dim=1)
    channels = [
        torch.asinh(bands_mm / _BAND_MM),
        support,
        torch.asinh((fill_mm - around_mm) / _AROUND_MM) * near,
        *(_log_noise(depth_mm, valid, step) for step in _NOISE_STEPS_PX),
        valid,
    ]
    return Features(fill_mm, bands_mm, torch.cat(channels, dim=1), even)


def front_and_back(noisy_mm: Tensor, fill_mm: Tensor) -> Tensor:
    """(B, 2, H, W): depth of the nearest and of the farthest surface measured within 6 px, mm.

    Each is a mean of samples: those less than 50 mm behind the nearest one, and those less than
    50 mm before the farthest. Without samples, both are ``fill_mm``.
    """
    measured = noisy_mm > 0
    depth_mm = torch.where(measured, noisy_mm, torch.inf)
    samples = list(_taps(depth_mm, torch.inf))
    nearest_mm = _extreme(torch.minimum, depth_mm, torch.inf)
    farthest_mm = _extreme(torch.maximum, torch.where(measured, noisy_mm, 0.0), 0.0)
    surfaces = []
    for extreme in (nearest_mm, farthest_mm):
        total, count = torch.zeros_like(fill_mm), torch.zeros_like(fill_mm)
        for sample in samples:
            same_surface = (sample - extreme).abs() < _SURFACE_MM  # false for inf, and inf - inf
            total += torch.where(same_surface, sample, 0.0)
            count += same_surface
        surfaces.append(torch.where(count > 0, total / count.clamp_min(1), fill_mm))
    return torch.cat(surfaces, dim=1)


def own_surface_mean(values: Tensor, fill_mm: Tensor, noisy_mm: Tensor, known: Tensor) -> Tensor:
    """Mean of known values on each pixel's own surface, (B, 1, H, W); 0 where there is none.

    The samples are 5x5, 3 px apart, measured within 50 mm of ``fill_mm``; weights are Tukey's.
    """
    total, weight_sum = torch.zeros_like(fill_mm), torch.zeros_like(fill_mm)
    depths = torch.where((noisy_mm > 0) & known, noisy_mm, torch.inf)
    for depth, value in zip(_taps(depths, torch.inf), _taps(values, 0.0), strict=True):
        weight = tukey((depth - fill_mm).clamp(-_SURFACE_MM, _SURFACE_MM) / _SURFACE_MM)
        total += weight * value
        weight_sum += weight
    return total / weight_sum.clamp_min(TINY)


def _taps(
    image: Tensor, outside: float, step_px: int = _TAP_STEP, taps: int = _TAPS
) -> Iterator[Tensor]:
    """Yield the image shifted to each sample of a grid around a pixel, ``taps`` to each side.

    outside: the value beyond the image.
    """
    height, width = image.shape[-2:]
    reach = taps * step_px
    around = F.pad(image, (reach,) * 4, value=outside)
    steps = range(0, 2 * reach + 1, step_px)
    for down in steps:
        for right in steps:
            yield around[..., down : down + height, right : right + width]


def _extreme(
    smaller_or_larger: Callable[[Tensor, Tensor], Tensor], image: Tensor, outside: float
) -> Tensor:
    """Least or largest of the samples of `_taps`, by rows and then by columns."""
    reach = _TAPS * _TAP_STEP
    for axis in (-2, -1):
        border = (0, 0, reach, reach) if axis == -2 else (reach, reach)
        around = F.pad(image, border, value=outside)
        steps = range(0, 2 * reach + 1, _TAP_STEP)
        shifted = [around.narrow(axis, step, image.shape[axis]) for step in steps]
        image = reduce(smaller_or_larger, shifted)
    return image


def _filled(depth_mm: Tensor, known: Tensor) -> Tensor:
    """Fill holes by rounds of normalised convolution; 0 where they do not reach."""
    for _ in range(_FILL_ROUNDS):
        grown_mm, reached = weighted_mean(depth_mm, known, _FILL_RADIUS, _FILL_SIGMA)
        depth_mm = torch.where(known > 0, depth_mm, grown_mm)
        known = torch.maximum(known, reached)
    return depth_mm


def _log_noise(depth_mm: Tensor, valid: Tensor, step_px: int) -> Tensor:
    mean_mm, reached = noise_around(depth_mm, valid, step_px)
    return torch.log(mean_mm + _LEAST_NOISE_MM) * reached


def noise_around(depth_mm: Tensor, valid: Tensor, step_px: int) -> tuple[Tensor, Tensor]:
    """Estimate the noise around each pixel, mm, and where it is known (0 or 1); (B, 1, H, W) each.

    It is the mean difference of pixels to the mean of four neighbours ``step_px`` away. Only
    pixels count whose neighbours are measured and within 50 mm.
    """
    around = F.pad(torch.where(valid > 0, depth_mm, torch.inf), (step_px,) * 4, value=torch.inf)
    height, width = depth_mm.shape[-2:]
    total, known = torch.zeros_like(depth_mm), valid
    for down, right in ((0, 1), (2, 1), (1, 0), (1, 2)):
        top, left = down * step_px, right * step_px
        offset = around[..., top : top + height, left : left + width] - depth_mm
        near = offset.abs() < _SURFACE_MM
        total = total + torch.where(near, offset, 0.0)
        known = known * near
    return weighted_mean((total / 4.0).abs(), known, _NOISE_RADIUS, _NOISE_SIGMA)


def local_mean(values: Tensor, known: Tensor) -> Tensor:
    """Mean of the known values around each pixel, Gaussian with a sigma of 12 px; 0 if none."""
    return shrunk_mean(values, known, _AROUND_RADIUS, _AROUND_SIGMA)


def _robust_mean(near_mm: Tensor, depth_mm: Tensor, valid: Tensor) -> Tensor:
    """Mean of the 5x5 measured depths around that are close to ``near_mm``.

    Weights are Tukey's, smooth at the limit: one step of a mean shift.
    """
    offset_sum, weight_sum = torch.zeros_like(near_mm), torch.zeros_like(near_mm)
    for sample in _taps(torch.where(valid > 0, depth_mm, torch.inf), torch.inf, 1):
        offset = (sample - near_mm).clamp(-_SURFACE_MM, _SURFACE_MM)
        weight = tukey(offset / _SURFACE_MM)
        offset_sum += weight * offset
        weight_sum += weight
    return near_mm + offset_sum / weight_sum.clamp_min(TINY)


def _support(near_mm: Tensor, depth_mm: Tensor, valid: Tensor) -> Tensor:
    """Share, 0-1, of 3x3 samples 6 px apart whose measured depth is close to ``near_mm``."""
    weight_sum = torch.zeros_like(near_mm)
    samples = torch.where(valid > 0, depth_mm, torch.inf)
    for sample in _taps(samples, torch.inf, _SUPPORT_STEP, 1):
        weight_sum += tukey((sample - near_mm).clamp(-_SURFACE_MM, _SURFACE_MM) / _SURFACE_MM)
    return weight_sum / 9


def tukey(ratio: Tensor) -> Tensor:
    """Return Tukey's biweight of ratios from -1 to 1: 1 at a ratio of 0, 0 at both ends."""
    return (1.0 - ratio.square()).square()


def _guided(
    depth_mm: Tensor, valid: Tensor, fill_mm: Tensor, base_mm: Tensor, radius: int
) -> Tensor:
    """Smooth depth, mm, by a guided filter whose guide is depth itself; holes have no weight.

    He, Sun and Tang, "Guided Image Filtering", TPAMI 2013. Depth is taken relative to ``base_mm``.
    A constant leaves the filter as it is; with a smooth surface slopes do not count as variance,
    but pixels near a step do, because that surface bends there.
    """
    offset = (depth_mm - base_mm) * valid
    share, mean, square = _box_means([valid, offset, offset.square()], radius)
    share = share.clamp_min(TINY)
    mean = mean / share
    variance = (square / share - mean.square()).clamp_min(0)
    gain = variance / (variance + _GUIDED_MM**2)
    gain_mean, bias_mean = _box_means([gain * valid, (1.0 - gain) * mean * valid], radius)
    return (gain_mean * (fill_mm - base_mm) + bias_mean) / share + base_mm


def _curved(depth_mm: Tensor, even: Tensor, otherwise_mm: Tensor, sigma: float) -> Tensor:
    """Smooth depth, mm, by a Gaussian of ``sigma`` px without flattening curved surfaces.

    A Gaussian mean flattens a curve. The mean of the residual brings back what it took (Tukey's
    twicing, here twice). Pixels near steps and holes are left out, so that no other surface
    enters the mean; they get ``otherwise_mm``.
    """
    radius = math.ceil(_CURVED_REACH * sigma)
    weight = blurred(even, radius, sigma).clamp_min(TINY)
    offset_mm = depth_mm - _MIDDLE_MM
    smooth_mm = torch.zeros_like(offset_mm)
    for _ in range(_CURVED_ROUNDS):
        smooth_mm = smooth_mm + blurred((offset_mm - smooth_mm) * even, radius, sigma) / weight
    return torch.where(even > 0, smooth_mm + _MIDDLE_MM, otherwise_mm)


def _box_means(images: list[Tensor], radius: int) -> tuple[Tensor, ...]:
    """Mean of each image over a square of half side ``radius``, a power of 2; outside is 0.

    Sums of 2, 4, 8 ... pixels in turn: convolution and average pooling take many times as long.
    """
    side = 2 * radius + 1
    sums = F.pad(torch.cat(images), (radius,) * 4)
    for axis in (-2, -1):
        last = sums.narrow(axis, side - 1, sums.shape[axis] - side + 1)
        width = 1
        while width < side - 1:
            count = sums.shape[axis] - width
            sums = sums.narrow(axis, 0, count) + sums.narrow(axis, width, count)
            width *= 2
        sums = sums.narrow(axis, 0, last.shape[axis]) + last
    means: tuple[Tensor, ...] = (sums / side**2).chunk(len(images))
    return means
