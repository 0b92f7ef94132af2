"""Input features of infrared and of neighbours in time; as local as those of `features`."""

from __future__ import annotations

from typing import Final, NamedTuple

import torch
from torch import Tensor

from glsim.denoise.inputs import NetworkInputs
from glsim.train.models.features import noise_around, tukey
from glsim.train.models.gaussian import shrunk_mean
from glsim.train.models.motion import predicted_change

#: A neighbour whose depth differs by more shows another surface, mm: the limit between surfaces
#: in `features`. A head moves by at most 10 mm from frame to frame at 30 Hz (0.3 m/s).
_SURFACE_MM: Final = 50.0
#: Differences enter as asinh(mm / this): linear for noise and motion, compressed beyond.
_DIFFERENCE_MM: Final = 10.0
#: A neighbour in time is not averaged where it differs, without its motion, by more than so many
#: times the noise around: the mean of a patch, which shows motion that was not predicted, and the
#: pixel itself. With larger limits, heads that turn fast are smeared; with smaller ones, smooth
#: noise counts as motion. By the error of `face` on means of five frames: 0.83 to 0.92 of that on
#: one frame for slow heads, 0.94 to 1.04 for heads six times as fast (20 mm and 10 degrees in four
#: frames); with the limit of the pixel alone 1.04 and 1.26.
_PATCH_LIMIT, _PIXEL_LIMIT = 3.0, 8.0
#: Radius and sigma of a patch, px.
_PATCH_RADIUS, _PATCH_SIGMA = 3, 1.5
#: The noise is that of pixels so far apart, where noise that a filter made smooth shows too, and at
#: least this, mm: half of the rounding to whole millimetres.
_NOISE_STEP_PX, _LEAST_NOISE_MM = 3, 0.15
#: Scale of the robust mean, mm: the correction that a network output of 1 makes.
_RELATIVE_MM: Final = 10.0
#: Largest difference of log infrared from its surface's: a factor of 20.
_LARGEST_LOG: Final = 3.0
#: Scale of log infrared: log of 65,535 counts is 11.
_LOG_SCALE: Final = 8.0

#: Channels of `infrared_features`, and of `neighbour_features` for each neighbour and for all.
_INFRARED, _EACH_NEIGHBOUR, _ALL_NEIGHBOURS = 2, 2, 2


def extra_channels(inputs: NetworkInputs) -> int:
    """Number of channels of the features of a network's inputs besides depth."""
    neighbours = inputs.before + inputs.after
    in_time = neighbours * _EACH_NEIGHBOUR + _ALL_NEIGHBOURS if neighbours else 0
    return in_time + _INFRARED * inputs.infrared


def infrared_features(infrared: Tensor, surface_log: Tensor) -> Tensor:
    """Features of infrared counts: (B, 1, H, W) to (B, 2, H, W); 0 where there are no counts.

    surface_log: mean of log(1 + counts) on each pixel's own surface. Channels: log infrared
    relative to that mean, which no gain changes; log(1 + counts) / 8, on which noise depends.
    """
    measured = (infrared > 0).to(infrared.dtype)
    log = log_counts(infrared)
    relative = (log - surface_log).clamp(-_LARGEST_LOG, _LARGEST_LOG) * measured
    return torch.cat([relative, log / _LOG_SCALE], dim=1)


def log_counts(infrared: Tensor) -> Tensor:
    """Return log(1 + counts), 0 for anything that is not above 0."""
    return torch.log(1.0 + torch.where(infrared > 0, infrared, 0.0))


class MeanOverTime(NamedTuple):
    """What averaging a frame with its N neighbours in time adds to it.

    offset_mm: (B, 1, H, W) what it adds to the frame's depth, mm; 0 where the frame or all
        neighbours have none.
    weight: (B, 1, H, W) sum of the neighbours' weights, divided by N: 0 to 1.
    motion_mm: (B, N, H, W) what motion added to the depth of each neighbour, mm.
    """

    offset_mm: Tensor
    weight: Tensor
    motion_mm: Tensor


def mean_over_time(neighbours_mm: Tensor, depth_mm: Tensor) -> MeanOverTime:
    """Average (B, 1, H, W) mm with N neighbouring frames, (B, N, H, W) mm, 0 = no return.

    The change of depth by motion (`motion.predicted_change`) is subtracted from the neighbours.
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
    """Features of N neighbouring frames, (B, N, H, W) mm, 0 = no return, to (B, 2 N + 2, H, W).

    fill_mm: (B, 1, H, W) depth without holes, of the mean over time. Channels:
        N differences to it without motion, asinh(mm / 10)
        N closeness of the neighbours: 1 for equal depth, 0 beyond 50 mm
        2 of the mean over time: what it added to the frame, in 10 mm, and its weight
    A neighbour that is missing, invalid or more than 50 mm away adds nothing to any channel.
    """
    difference, near = _differences(neighbours_mm, fill_mm)
    still = (difference - mean.motion_mm) * near
    closeness = tukey(difference / _SURFACE_MM) * near
    channels = [
        torch.asinh(still / _DIFFERENCE_MM),
        closeness,
        mean.offset_mm / _RELATIVE_MM,
        mean.weight,
    ]
    return torch.cat(channels, dim=1)


def _differences(neighbours_mm: Tensor, depth_mm: Tensor) -> tuple[Tensor, Tensor]:
    """Differences of neighbours to a frame, mm, and where they are on its surface, 0 or 1."""
    difference = neighbours_mm - depth_mm
    is_near = (neighbours_mm > 0) & (depth_mm > 0) & (difference.abs() < _SURFACE_MM)
    return torch.where(is_near, difference, 0.0), is_near.to(depth_mm.dtype)
