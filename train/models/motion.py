"""Estimate how surfaces move between depth frames, without intrinsics.

Where a surface moves by (u, v) px in the image and w mm in depth, its depth at a pixel changes by
w + u Gx + v Gy, with the gradient G of depth: the range flow constraint (Spies, Jaehne and Barron,
"Range Flow Estimation", CVIU 2002). u, v and w are those that fit the neighbourhood best, as Lucas
and Kanade fit the optical flow.
"""

from __future__ import annotations

from typing import Final

import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from glsim.train.models.backbone import pad_to_multiple
from glsim.train.models.gaussian import blurred, weighted_mean

#: Radius and sigma of the neighbourhood, in pixels of half the size. A larger one is better for
#: slow heads, whose motion it knows more exactly, and worse for fast ones, whose parts differ: with
#: 16 in place of 12 px of full size, `face` has 0.81 in place of 0.83 and 1.07 in place of 1.04 of
#: its error on one frame (means of five frames, random cameras and a Kinect V2).
_RADIUS, _SIGMA = 12, 6.0
#: Radius and sigma of the smoothing before a gradient is taken, px.
_SMOOTH_RADIUS, _SMOOTH_SIGMA = 3, 1.5
#: Steeper pixels are at a step, mm a pixel: a surface at 70 degrees has 7 at 2.5 mm a pixel.
_STEEPEST: Final = 8.0
#: Added to means over a neighbourhood: where little of it is known, motion is 0.
_PRIOR: Final = 0.02


def predicted_change(difference_mm: Tensor, near: Tensor, frames_mm: Tensor) -> Tensor:
    """Predict by how much motion changes depth from a frame to its neighbours, (B, N, H, W) mm.

    difference_mm: (B, N, H, W) depth of the neighbours less that of the frame; near: the same
    shape, 1 where both show one surface, else 0. frames_mm: (B, 1 + N, H, W) depth of the frame and
    of its neighbours, mm; pixels not above 0, or not a number, are holes.
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
    """Return the gradients of depth along rows and columns, mm per pixel, and their known mask."""
    measured = (depth_mm > 0).to(depth_mm.dtype)
    depth_mm = torch.where(depth_mm > 0, depth_mm, 0.0)
    smooth_mm, reached = weighted_mean(depth_mm, measured, _SMOOTH_RADIUS, _SMOOTH_SIGMA)
    smooth_mm, reached = (F.pad(image, (1,) * 4) for image in (smooth_mm, reached))
    left, right = (..., slice(1, -1), slice(0, -2)), (..., slice(1, -1), slice(2, None))
    above, below = (..., slice(0, -2), slice(1, -1)), (..., slice(2, None), slice(1, -1))
    across = 0.5 * (smooth_mm[right] - smooth_mm[left])
    down = 0.5 * (smooth_mm[below] - smooth_mm[above])
    return across, down, reached[right] * reached[left] * reached[below] * reached[above]
