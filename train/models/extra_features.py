"""Input features of infrared and of neighbours in time; as local as those of `features`."""

from __future__ import annotations

from typing import Final

import torch
from torch import Tensor

from glsim.denoise.inputs import Inputs

#: A neighbour whose depth differs by more shows another surface, mm: the limit between surfaces
#: in `features`. A head moves by at most 10 mm from frame to frame at 30 Hz (0.3 m/s).
_SURFACE_MM: Final = 50.0
#: Differences enter as asinh(mm / this): linear for noise and motion, compressed beyond.
_DIFFERENCE_MM: Final = 10.0
#: Limit of the robust mean over time, mm: six times the noise of two frames at 2 m; a surface that
#: moved by more is not averaged.
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


def neighbour_features(neighbours_mm: Tensor, fill_mm: Tensor) -> Tensor:
    """Features of N neighbouring frames, (B, N, H, W) mm, 0 = no return, to (B, 2 N + 2, H, W).

    fill_mm: (B, 1, H, W) depth of the present frame without holes. Channels: the differences to it
    of all neighbours, asinh(mm / 10); how close each is, 1 for equal depth and 0 beyond 50 mm; the
    robust mean over time of frame and neighbours relative to the frame, in 10 mm, with weights
    (1 - (difference / 20 mm)^2)^2; and the sum of the neighbours' weights, divided by N. A
    neighbour that is missing, invalid or more than 50 mm away adds nothing to any channel.
    """
    difference = neighbours_mm - fill_mm
    measured = ((neighbours_mm > 0) & (fill_mm > 0)).to(fill_mm.dtype)
    bounded = difference.clamp(-_SURFACE_MM, _SURFACE_MM)
    closeness = (1.0 - (bounded / _SURFACE_MM).square()).square() * measured
    near = (bounded.abs() < _SURFACE_MM).to(fill_mm.dtype) * measured
    bounded = difference.clamp(-_MEAN_LIMIT_MM, _MEAN_LIMIT_MM)
    weight = (1.0 - (bounded / _MEAN_LIMIT_MM).square()).square() * measured
    total = weight.sum(dim=1, keepdim=True)
    mean = (weight * bounded).sum(dim=1, keepdim=True) / (1.0 + total)
    channels = [
        torch.asinh(difference.clamp(-_SURFACE_MM, _SURFACE_MM) / _DIFFERENCE_MM) * near,
        closeness,
        mean / _RELATIVE_MM,
        total / neighbours_mm.shape[1],
    ]
    return torch.cat(channels, dim=1)
