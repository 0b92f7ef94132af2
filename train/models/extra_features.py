"""Input features of infrared and of neighbours in time; as local as those of `features`."""

from __future__ import annotations

from typing import Final, NamedTuple

import torch
from torch import Tensor

from glsim.denoise.inputs import Inputs
from glsim.train.models.features import local_mean

#: A neighbour whose depth differs by more shows another surface, mm: the limit between surfaces
#: in `features`. A head moves by at most 10 mm from frame to frame at 30 Hz (0.3 m/s).
_SURFACE_MM: Final = 50.0
#: Differences enter as asinh(mm / this): linear for noise and motion, compressed beyond.
_DIFFERENCE_MM: Final = 10.0
#: Limit of the robust mean over time, mm: what moved by more, apart from the motion around it, is
#: not averaged. With 10, 20 and 50 mm the error of that mean is 1.40, 1.34 and 1.30 mm (frames as
#: in `mean_over_time`); a small limit is safer at the rims of what moves.
_MEAN_LIMIT_MM: Final = 20.0
#: Scale of the robust mean, mm: the correction that a network output of 1 makes.
_RELATIVE_MM: Final = 10.0
#: Largest difference of log infrared from its surface's: a factor of 20.
_LARGEST_LOG: Final = 3.0
#: Scale of log infrared: log of 65,535 counts is 11.
_LOG_SCALE: Final = 8.0

#: Channels of `infrared_features`, and of `neighbour_features` for each neighbour and for all.
_INFRARED, _EACH_NEIGHBOUR, _ALL_NEIGHBOURS = 2, 2, 2


def extra_channels(inputs: Inputs) -> int:
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
    """Robust mean of a frame and its N neighbours, each (B, 1, H, W).

    offset_mm: what it adds to the frame's depth, mm; 0 where the frame or all neighbours have none.
    weight: sum of the neighbours' weights, divided by N: 0 to 1.
    """

    offset_mm: Tensor
    weight: Tensor


def mean_over_time(neighbours_mm: Tensor, depth_mm: Tensor) -> MeanOverTime:
    """Average (B, 1, H, W) mm with N neighbouring frames, (B, N, H, W) mm, 0 = no return.

    The mean compensates motion: the local mean of a neighbour's differences, by which the surface
    around moved, is subtracted. On moving heads (84 frames of kinect-v2 at 0.5 to 1.45 m, 30 Hz,
    four earlier frames) the interior error of the mean is 1.33 mm, 1.51 without compensation; the
    noisy frame has 1.82.
    """
    difference, near = _differences(neighbours_mm, depth_mm)
    total, weight_sum = torch.zeros_like(depth_mm), torch.zeros_like(depth_mm)
    count = int(neighbours_mm.shape[1])  # a plain number, also where a graph is exported
    for place in range(count):
        # Slices, because OpenCV does not run ONNX's Split.
        one, known = difference[:, place : place + 1], near[:, place : place + 1]
        moved = one - local_mean(one, known) * known
        bounded = moved.clamp(-_MEAN_LIMIT_MM, _MEAN_LIMIT_MM)
        weight = (1.0 - (bounded / _MEAN_LIMIT_MM).square()).square() * known
        total = total + weight * bounded
        weight_sum = weight_sum + weight
    return MeanOverTime(total / (1.0 + weight_sum), weight_sum / count)


def neighbour_features(neighbours_mm: Tensor, fill_mm: Tensor, mean: MeanOverTime) -> Tensor:
    """Features of N neighbouring frames, (B, N, H, W) mm, 0 = no return, to (B, 2 N + 2, H, W).

    fill_mm: (B, 1, H, W) depth without holes, of the mean over time. Channels:
        N differences to it, asinh(mm / 10)
        N closeness of the neighbours: 1 for equal depth, 0 beyond 50 mm
        2 of the mean over time: what it added to the frame, in 10 mm, and its weight
    A neighbour that is missing, invalid or more than 50 mm away adds nothing to any channel.
    """
    difference, near = _differences(neighbours_mm, fill_mm)
    closeness = (1.0 - (difference / _SURFACE_MM).square()).square() * near
    channels = [
        torch.asinh(difference / _DIFFERENCE_MM),
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
