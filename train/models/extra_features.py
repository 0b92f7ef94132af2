"""Input features from neighbours in time; all are local, like `features`."""

from __future__ import annotations

from typing import Final, NamedTuple

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from glsim.core.depth_map import FLYING_MM
from glsim.networks.inputs import NetworkInputs
from glsim.train.models.backbone import pad_to_multiple
from glsim.train.models.features import noise_around, tukey
from glsim.train.models.gaussian import blurred, shrunk_mean, weighted_mean

#: A difference d becomes asinh(d / this), mm: linear for noise and motion, compressed beyond.
_DIFFERENCE_MM: Final = 10.0
#: A neighbour is averaged if its motion-compensated difference is below these multiples of the
#: local noise: for the mean over a patch, and for the pixel. Chosen by the error of `face` on slow
#: and fast heads: larger limits blur motion, smaller limits take noise for motion.
_PATCH_LIMIT, _PIXEL_LIMIT = 3.0, 8.0
#: Radius and sigma of a patch, px.
_PATCH_RADIUS, _PATCH_SIGMA = 3, 1.5
#: Noise is estimated from pixels at this distance, px, where smooth noise differs, too; and the
#: smallest noise, mm: half of the noise of rounding to whole millimetres.
_NOISE_STEP_PX, _LEAST_NOISE_MM = 3, 0.15
#: Scale of the mean over time, mm: a network output of 1 corrects depth by this.
_RELATIVE_MM: Final = 10.0
#: Channels of `neighbour_features` for each neighbour and for all.
_EACH_NEIGHBOUR, _ALL_NEIGHBOURS = 2, 2


def extra_channels(inputs: NetworkInputs) -> int:
    """Count the feature channels of a network's inputs besides depth."""
    neighbours = inputs.before + inputs.after
    return neighbours * _EACH_NEIGHBOUR + _ALL_NEIGHBOURS if neighbours else 0


class MeanOverTime(NamedTuple):
    """Result of averaging a frame with its N neighbours in time.

    Attributes:
        offset_mm: (B, 1, H, W) mean minus the frame's depth; 0 where either is unknown.
        weight: (B, 1, H, W) mean weight of the neighbours, 0 to 1.
        motion_mm: (B, N, H, W) change of depth by motion in each neighbour.
    """

    offset_mm: Tensor
    weight: Tensor
    motion_mm: Tensor


def mean_over_time(neighbours_mm: Tensor, depth_mm: Tensor) -> MeanOverTime:
    """Average (B, 1, H, W) mm with N neighbouring frames, (B, N, H, W) mm, 0 = no return.

    The change of depth by motion (`predicted_change`) is subtracted from the neighbours.
    """
    difference, near = _differences(neighbours_mm, depth_mm)
    frames_mm = torch.cat([depth_mm, neighbours_mm], dim=1)
    motion_mm = predicted_change(difference, near, frames_mm)
    still = (difference - motion_mm) * near
    valid = (depth_mm > 0).to(depth_mm.dtype)
    noise_mm, _ = noise_around(torch.where(depth_mm > 0, depth_mm, 0.0), valid, _NOISE_STEP_PX)
    noise_mm = noise_mm.clamp_min(_LEAST_NOISE_MM)
    patch = shrunk_mean(still, near, _PATCH_RADIUS, _PATCH_SIGMA)
    weights = near * tukey((patch / (_PATCH_LIMIT * noise_mm)).clamp(-1.0, 1.0))
    weights = weights * tukey((still / (_PIXEL_LIMIT * noise_mm)).clamp(-1.0, 1.0))
    weight_sum = weights.sum(1, keepdim=True)
    offset_mm = (weights * still).sum(1, keepdim=True) / (1.0 + weight_sum)
    count = int(neighbours_mm.shape[1])  # a plain number, also where a graph is exported
    return MeanOverTime(offset_mm, weight_sum / count, motion_mm)


def neighbour_features(neighbours_mm: Tensor, fill_mm: Tensor, mean: MeanOverTime) -> Tensor:
    """Compute the features of N neighbouring frames.

    Every channel is 0 for missing and invalid neighbours, and for differences above 50 mm.

    ``fill_mm`` is the mean over time, without holes. Returns (B, 2 N + 2, H, W): N
    motion-compensated differences, asinh(mm / 10); N similarities, 1 for equal depth, 0 beyond
    50 mm; offset (in 10 mm) and weight of the mean over time.
    """
    difference, near = _differences(neighbours_mm, fill_mm)
    still = (difference - mean.motion_mm) * near
    closeness = tukey(difference / FLYING_MM) * near
    channels = [
        torch.asinh(still / _DIFFERENCE_MM),
        closeness,
        mean.offset_mm / _RELATIVE_MM,
        mean.weight,
    ]
    return torch.cat(channels, dim=1)


def _differences(neighbours_mm: Tensor, depth_mm: Tensor) -> tuple[Tensor, Tensor]:
    """Subtract a frame from its neighbours, mm; also return a mask (0 or 1) of equal surfaces."""
    difference = neighbours_mm - depth_mm
    is_near = (neighbours_mm > 0) & (depth_mm > 0) & (difference.abs() < FLYING_MM)
    return torch.where(is_near, difference, 0.0), is_near.to(depth_mm.dtype)


#: Radius and sigma of the neighbourhood in which motion is fitted, px of the half-size image. A
#: larger neighbourhood is more exact for slow heads and worse for fast heads, whose parts move
#: differently. With 16 instead of 12 px of full size, the error of `face` over its error on one
#: frame is 0.81 instead of 0.83 (slow) and 1.07 instead of 1.04 (fast): means of five frames,
#: random cameras and a Kinect V2.
_RADIUS, _SIGMA = 12, 6.0
#: Radius and sigma of the smoothing before the gradient, px.
_SMOOTH_RADIUS, _SMOOTH_SIGMA = 3, 1.5
#: Largest gradient of a surface, mm per px; at 2.5 mm per px, a tilt of 70 degrees gives 7.
_STEEPEST: Final = 8.0
#: Weight of the prior (no motion) in a fit: motion is near 0 where few pixels are known.
_PRIOR: Final = 0.02


def predicted_change(difference_mm: Tensor, near: Tensor, frames_mm: Tensor) -> Tensor:
    """Predict the depth change by motion from a frame to its neighbours, (B, N, H, W) mm.

    Where a surface moves by (u, v) px in the image and w mm in depth, its depth at a pixel changes
    by w + u Gx + v Gy, with the gradient G of depth: the range flow constraint (Spies, Jaehne and
    Barron, "Range Flow Estimation", CVIU 2002). u, v and w fit the neighbourhood best, as in Lucas
    and Kanade's optical flow; no intrinsics are needed.

    Args:
        difference_mm: (B, N, H, W) depth of the neighbours minus depth of the frame.
        near: (B, N, H, W), 1 where frame and neighbour show the same surface, else 0.
        frames_mm: (B, 1 + N, H, W) depth of the frame and of its neighbours; pixels not above 0,
            or not a number, are holes.
    """
    count = int(difference_mm.shape[1])  # a plain number, also where a graph is exported
    across, down, known = _gradients(frames_mm)
    # The mean of both gradients is right to the second order of the motion.
    across = 0.5 * (across[:, :1] + across[:, 1:])
    down = 0.5 * (down[:, :1] + down[:, 1:])
    used = near * known[:, :1] * known[:, 1:]
    used = used * (across.abs() < _STEEPEST) * (down.abs() < _STEEPEST)
    across, down, change = (torch.where(used > 0, x, 0.0) for x in (across, down, difference_mm))
    products = (
        used, across, down, across * across, across * down, down * down,
        change, change * across, change * down,
    )  # fmt: skip
    halved = F.avg_pool2d(pad_to_multiple(torch.cat(products, dim=1), 2), 2)
    sums = blurred(halved, _RADIUS, _SIGMA)
    one, x, y, xx, xy, yy, t, tx, ty = (
        sums[:, k * count : (k + 1) * count] for k in range(len(products))
    )
    one = one + _PRIOR
    xx, xy, yy = xx - x * x / one + _PRIOR, xy - x * y / one, yy - y * y / one + _PRIOR
    tx, ty = tx - x * t / one, ty - y * t / one
    determinant = xx * yy - xy * xy
    u = (yy * tx - xy * ty) / determinant
    v = (xx * ty - xy * tx) / determinant
    w = (t - u * x - v * y) / one
    flow = F.interpolate(
        torch.cat([w, u, v], dim=1), scale_factor=2, mode="bilinear", align_corners=False
    )[..., : difference_mm.shape[-2], : difference_mm.shape[-1]]
    w, u, v = (flow[:, k * count : (k + 1) * count] for k in range(3))
    return w + u * across + v * down


def _gradients(depth_mm: Tensor) -> tuple[Tensor, Tensor, Tensor]:
    """Compute the depth gradients along rows and columns, mm per px, and a mask of known ones."""
    measured = (depth_mm > 0).to(depth_mm.dtype)
    depth_mm = torch.where(depth_mm > 0, depth_mm, 0.0)
    smooth_mm, reached = weighted_mean(depth_mm, measured, _SMOOTH_RADIUS, _SMOOTH_SIGMA)
    smooth_mm, reached = (F.pad(image, (1,) * 4) for image in (smooth_mm, reached))
    left, right = (..., slice(1, -1), slice(0, -2)), (..., slice(1, -1), slice(2, None))
    above, below = (..., slice(0, -2), slice(1, -1)), (..., slice(2, None), slice(1, -1))
    across = 0.5 * (smooth_mm[right] - smooth_mm[left])
    down = 0.5 * (smooth_mm[below] - smooth_mm[above])
    return across, down, reached[right] * reached[left] * reached[below] * reached[above]
