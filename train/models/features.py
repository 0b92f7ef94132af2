"""Input features of mask-aware networks: depth differences, smoothed depth, noise, validity.

Each feature depends only on a neighbourhood of its pixel: a crop has the features of the frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache, reduce
from typing import Final, Literal, NamedTuple, get_args

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from glsim.core.depth_map import FLYING_MM
from glsim.train.models.gaussian import TINY, blurred, shrunk_mean, weighted_mean

#: Edge-preserving filters of `depth_features`, by increasing strength: guided filters of radius 1,
#: 2 and 4 px, a robust mean of 5x5 px, curve-preserving Gaussians of 3 and 5 px, and the guided
#: filter of 4 px relative to the surrounding mean, which also smooths slopes.
FilterName = Literal["guided_1", "robust", "guided_2", "curved_3", "guided_4", "curved_5", "slopes"]
FILTERS: Final[tuple[FilterName, ...]] = get_args(FilterName)
#: Number of channels of `depth_features` besides the filters' channels; the last is validity.
OTHER_CHANNELS: Final = 5

#: Hole filling: rounds, radius and sigma of the Gaussian, px. Chosen: fills drop-outs up to 24 px.
_FILL_ROUNDS, _FILL_RADIUS, _FILL_SIGMA = 3, 4, 1.5
#: Radius and sigma of the surrounding mean, px. Chosen: wider than a nose at 0.9 m (14 px).
_AROUND_RADIUS, _AROUND_SIGMA = 24, 12.0
#: Grid of samples: number of samples to each side of a pixel, and distance of samples, px.
_TAPS, _TAP_STEP = 2, 3
#: Epsilon of the guided filters, mm: best on real Kinect V2 frames (docs/results/real_frames.md).
_GUIDED_MM: Final = 15.0
#: Radius of `_curved`'s Gaussians, in sigmas: at most 10 px, so that none crosses a depth step.
_CURVED_REACH: Final = 2.0
#: Number of means in `_curved`: the mean of the depth, then means of the residuals.
_CURVED_ROUNDS: Final = 3
#: Subtracted from depth before it is squared, mm: float32 is then exact to 1 mm2 up to 4.5 m.
_MIDDLE_MM: Final = 1000.0
#: Distance between the 3x3 samples of `_support`, px.
_SUPPORT_STEP: Final = 6
#: A pixel of more support is away from steps and holes; a straight edge within 5 px gives 2/3.
_EVEN_SUPPORT: Final = 0.75
#: Noise is estimated at two distances between pixels, px; smooth noise is seen only at the second.
_NOISE_STEPS_PX: Final = (1, 3)
#: Radius and sigma of the Gaussian that averages the noise, px.
_NOISE_RADIUS, _NOISE_SIGMA = 12, 6.0
#: Added to the noise before its logarithm, mm; it is below the noise of rounding to whole mm.
_LEAST_NOISE_MM: Final = 0.1
#: Divisors of the bands and of depth relative to its surroundings, mm. Measured: bands of training
#: frames have standard deviations of 0.4 to 1.8 mm.
_BAND_MM, _AROUND_MM = 2.0, 20.0


class Features(NamedTuple):
    """Features of a batch of frames, float32, at the frames' size.

    Attributes:
        fill_mm: (B, 1, H, W) depth; holes near measured pixels are filled, far holes are 0.
        bands_mm: (B, N, H, W) differences between successive filters of increasing strength; their
            sum is the correction by the last filter, at most 50 mm. Differences are less correlated
            than filtered maps.
        channels: (B, N + OTHER_CHANNELS, H, W), about -5 to 5, 0 where undefined:
            first N: asinh(bands_mm / 2 mm)
            share of the neighbourhood on the pixel's surface, 0 to 1; near 0 for a flying pixel
            depth relative to the surrounding mean, asinh(mm / 20)
            two: log of the local noise, mm, between pixels 1 and 3 px apart
            validity, 0 or 1
        even: (B, 1, H, W), 1 on measured pixels away from steps and holes, else 0.

    No feature holds the distance, from which a network would learn the bias of training cameras.
    """

    fill_mm: Tensor
    bands_mm: Tensor
    channels: Tensor
    even: Tensor


def depth_features(noisy_mm: Tensor, filters: Sequence[FilterName] = FILTERS) -> Features:
    """Compute the network's inputs from depth maps: filtered depth, noise and validity.

    Args:
        noisy_mm: (B, 1, H, W) millimetres; a pixel not above 0, or not a number, is a hole.
        filters: the N filters whose bands are features, in the order of FILTERS; at least one.
    """
    measured = noisy_mm > 0
    valid = measured.to(noisy_mm.dtype)
    depth_mm = torch.where(measured, noisy_mm, 0.0)
    around_mm, near = weighted_mean(depth_mm, valid, _AROUND_RADIUS, _AROUND_SIGMA)
    fill_mm = _filled(depth_mm, valid)
    fill_mm = torch.where(fill_mm > 0, fill_mm, around_mm)
    middle_mm = torch.full_like(fill_mm, _MIDDLE_MM)
    support = _support(fill_mm, depth_mm, valid)
    even = valid * (support > _EVEN_SUPPORT)

    @cache  # the curve-preserving Gaussians use guided(2), too
    def guided(radius: int) -> Tensor:
        return _guided(depth_mm, valid, fill_mm, middle_mm, radius)

    filter_functions: dict[FilterName, Callable[[], Tensor]] = {
        "guided_1": lambda: guided(1),
        "guided_2": lambda: guided(2),
        "guided_4": lambda: guided(4),
        # Chosen, 3 and 5 px: least error under white noise.
        "curved_3": lambda: _curved(depth_mm, even, guided(2), 3.0),
        "curved_5": lambda: _curved(depth_mm, even, guided(2), 5.0),
        "robust": lambda: _robust_mean(fill_mm, depth_mm, valid),
        "slopes": lambda: _guided(depth_mm, valid, fill_mm, around_mm, 4),
    }
    # In the order of the functions, so that a shipped network is exported byte for byte again.
    by_name = {name: smooth() for name, smooth in filter_functions.items() if name in filters}
    smoothed = torch.cat([by_name[name] for name in filters], dim=1)
    filtered_mm = (smoothed - fill_mm).clamp(-FLYING_MM, FLYING_MM)
    bands_mm = torch.cat([filtered_mm[:, :1], filtered_mm[:, 1:] - filtered_mm[:, :-1]], dim=1)
    channels = [
        torch.asinh(bands_mm / _BAND_MM),
        support,
        torch.asinh((fill_mm - around_mm) / _AROUND_MM) * near,
        *(
            torch.log(noise_mm + _LEAST_NOISE_MM) * reached
            for noise_mm, reached in (noise_around(depth_mm, valid, n) for n in _NOISE_STEPS_PX)
        ),
        valid,
    ]
    return Features(fill_mm, bands_mm, torch.cat(channels, dim=1), even)


def front_and_back(noisy_mm: Tensor, fill_mm: Tensor) -> Tensor:
    """Find the depth of the nearest and of the farthest surface within 6 px, (B, 2, H, W) mm.

    The depth of a surface is the mean of all samples within 50 mm of the nearest (or farthest)
    sample; without samples, it is ``fill_mm``.
    """
    measured = noisy_mm > 0
    depth_mm = torch.where(measured, noisy_mm, torch.inf)
    samples = _taps(depth_mm, torch.inf)
    nearest_mm = _extreme(torch.minimum, depth_mm, torch.inf)
    farthest_mm = _extreme(torch.maximum, torch.where(measured, noisy_mm, 0.0), 0.0)
    surfaces = []
    for extreme in (nearest_mm, farthest_mm):
        same_surface = (samples - extreme).abs() < FLYING_MM  # false for inf, and inf - inf
        total = _summed(torch.where(same_surface, samples, 0.0))
        count = _summed(same_surface.to(fill_mm.dtype))
        surfaces.append(torch.where(count > 0, total / count.clamp_min(1), fill_mm))
    return torch.cat(surfaces, dim=1)


def _taps(image: Tensor, outside: float, step_px: int = _TAP_STEP, taps: int = _TAPS) -> Tensor:
    """Sample a grid around each pixel, a channel per sample; beyond the image is ``outside``."""
    height, width = image.shape[-2:]
    reach = taps * step_px
    around = F.pad(image, (reach,) * 4, value=outside)
    steps = range(0, 2 * reach + 1, step_px)
    shifted = [
        around[..., down : down + height, right : right + width]
        for down in steps
        for right in steps
    ]
    return torch.cat(shifted, dim=1)


def _summed(samples: Tensor) -> Tensor:
    """Sum the samples of `_taps`. A convolution: onnxruntime reduces channels far more slowly."""
    return F.conv2d(samples, samples.new_ones(1, (2 * _TAPS + 1) ** 2, 1, 1))


def _extreme(
    smaller_or_larger: Callable[[Tensor, Tensor], Tensor], image: Tensor, outside: float
) -> Tensor:
    """Compute the minimum or maximum over the grid of `_taps`, by rows, then by columns."""
    reach = _TAPS * _TAP_STEP
    for axis in (-2, -1):
        border = (0, 0, reach, reach) if axis == -2 else (reach, reach)
        around = F.pad(image, border, value=outside)
        steps = range(0, 2 * reach + 1, _TAP_STEP)
        shifted = [around.narrow(axis, step, image.shape[axis]) for step in steps]
        image = reduce(smaller_or_larger, shifted)
    return image


def _filled(depth_mm: Tensor, known: Tensor) -> Tensor:
    """Fill holes by rounds of normalised convolution; pixels that no round reaches become 0."""
    for _ in range(_FILL_ROUNDS):
        grown_mm, reached = weighted_mean(depth_mm, known, _FILL_RADIUS, _FILL_SIGMA)
        depth_mm = torch.where(known > 0, depth_mm, grown_mm)
        known = torch.maximum(known, reached)
    return depth_mm


def noise_around(depth_mm: Tensor, valid: Tensor, step_px: int) -> tuple[Tensor, Tensor]:
    """Estimate the local noise, mm, and a mask (0 or 1) of known values, (B, 1, H, W) each.

    The estimate is the mean absolute difference between a pixel and the mean of its four neighbours
    at ``step_px``, over pixels whose neighbours are measured and within 50 mm.
    """
    around = F.pad(torch.where(valid > 0, depth_mm, torch.inf), (step_px,) * 4, value=torch.inf)
    height, width = depth_mm.shape[-2:]
    total, known = torch.zeros_like(depth_mm), valid
    for down, right in ((0, 1), (2, 1), (1, 0), (1, 2)):
        top, left = down * step_px, right * step_px
        offset = around[..., top : top + height, left : left + width] - depth_mm
        near = offset.abs() < FLYING_MM
        total = total + torch.where(near, offset, 0.0)
        known = known * near
    return weighted_mean((total / 4.0).abs(), known, _NOISE_RADIUS, _NOISE_SIGMA)


def local_mean(values: Tensor, known: Tensor) -> Tensor:
    """Compute the Gaussian mean of known values, sigma 12 px; 0 without known values."""
    return shrunk_mean(values, known, _AROUND_RADIUS, _AROUND_SIGMA)


def _robust_mean(near_mm: Tensor, depth_mm: Tensor, valid: Tensor) -> Tensor:
    """Average 5x5 measured depths with Tukey's weights around ``near_mm`` (a mean-shift step)."""
    samples = _taps(torch.where(valid > 0, depth_mm, torch.inf), torch.inf, 1)
    ratio = ((samples - near_mm) / FLYING_MM).clamp(-1, 1)
    weight = tukey(ratio)
    offset_mm = FLYING_MM * _summed(weight * ratio)
    return near_mm + offset_mm / _summed(weight).clamp_min(TINY)


def _support(near_mm: Tensor, depth_mm: Tensor, valid: Tensor) -> Tensor:
    """Compute the share (0 to 1) of 3x3 samples, 6 px apart, on the surface of ``near_mm``."""
    samples = _taps(torch.where(valid > 0, depth_mm, torch.inf), torch.inf, _SUPPORT_STEP, 1)
    return tukey(((samples - near_mm) / FLYING_MM).clamp(-1, 1)).mean(1, keepdim=True)


def tukey(ratio: Tensor) -> Tensor:
    """Compute Tukey's biweight of a ratio in [-1, 1]: 1 at 0, and 0 at -1 and 1."""
    return (1.0 - ratio.square()).square()


def _guided(
    depth_mm: Tensor, valid: Tensor, fill_mm: Tensor, base_mm: Tensor, radius: int
) -> Tensor:
    """Smooth depth by a self-guided filter without influence of holes.

    He, Sun and Tang, "Guided Image Filtering", TPAMI 2013, on depth relative to ``base_mm``: with a
    smooth surface as the base, slopes do not count as variance.
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
    """Smooth depth by a Gaussian of ``sigma`` px without flattening curved surfaces.

    The means of the residuals are added (Tukey's twicing). Pixels near steps and holes are excluded
    and get ``otherwise_mm``.
    """
    radius = math.ceil(_CURVED_REACH * sigma)
    weight = blurred(even, radius, sigma).clamp_min(TINY)
    offset_mm = depth_mm - _MIDDLE_MM
    smooth_mm = torch.zeros_like(offset_mm)
    for _ in range(_CURVED_ROUNDS):
        smooth_mm = smooth_mm + blurred((offset_mm - smooth_mm) * even, radius, sigma) / weight
    return torch.where(even > 0, smooth_mm + _MIDDLE_MM, otherwise_mm)


def _box_means(images: list[Tensor], radius: int) -> tuple[Tensor, ...]:
    """Average each image over squares of half side ``radius``, a power of 2; pixels outside are 0.

    Sums of 2, 4, 8 ... pixels in turn are much faster than average pooling.
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
