"""Test Gaussian blurs and the motion that is estimated between depth frames."""

from __future__ import annotations

import math

import pytest
import torch
import torch.nn.functional as F  # noqa: N812
from torch import Tensor

from glsim.train.models.extra_features import mean_over_time, neighbour_features
from glsim.train.models.gaussian import blurred, weighted_mean
from glsim.train.models.motion import predicted_change

HEIGHT, WIDTH = 96, 112


def face_like(right_px: float = 0.0, down_px: float = 0.0, back_mm: float = 0.0) -> Tensor:
    """Return the depth, (1, 1, H, W) mm, of a round head with a nose, moved by pixels and mm."""
    y, x = torch.meshgrid(torch.arange(HEIGHT) - 48.0, torch.arange(WIDTH) - 56.0, indexing="ij")
    x, y = 2.5 * (x - right_px), 2.5 * (y - down_px)
    head = 990.0 - torch.sqrt((150.0**2 - x**2 - y**2).clamp_min(1.0)) * 0.6
    nose = 25.0 * torch.exp(-0.5 * ((x / 12) ** 2 + ((y - 5) / 20) ** 2))
    return (head - nose + back_mm)[None, None]


def noise(count: int, sigma_mm: float, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return sigma_mm * torch.randn(1, count, HEIGHT, WIDTH, generator=generator)


def rms(error_mm: Tensor) -> float:
    return float(error_mm[..., 24:-24, 24:-24].square().mean().sqrt())


def changes(neighbour_mm: Tensor, now_mm: Tensor) -> Tensor:
    difference = neighbour_mm - now_mm
    near = (difference.abs() < 50).float() * (neighbour_mm > 0) * (now_mm > 0)
    frames_mm = torch.cat([now_mm, neighbour_mm], 1)
    return predicted_change(difference * near, near, frames_mm)


@pytest.mark.parametrize(("radius", "sigma"), [(1, 0.7), (4, 1.5), (24, 12.0)])
def test_the_blur_is_the_convolution_with_a_gaussian(radius: int, sigma: float) -> None:
    images = torch.rand(2, 3, 40, 53, generator=torch.Generator().manual_seed(1))
    x = torch.arange(-radius, radius + 1)
    row = torch.exp(-0.5 * (x / sigma) ** 2)
    kernel = torch.outer(row, row) / row.sum() ** 2
    wanted = F.conv2d(images.view(6, 1, 40, 53), kernel[None, None], padding=radius)
    torch.testing.assert_close(blurred(images, radius, sigma), wanted.view_as(images))


def test_a_weighted_mean_leaves_out_what_is_unknown() -> None:
    values = torch.full((1, 1, 30, 30), 900.0)
    known = torch.ones_like(values)
    known[..., :, 12:] = 0.0
    mean, reached = weighted_mean(torch.where(known > 0, values, 7.0), known, 4, 1.5)
    assert reached[..., :16].all()
    assert not reached[..., 16:].any()
    torch.testing.assert_close(mean[..., :16], values[..., :16])


@pytest.mark.parametrize("motion", [(1.5, 0.0, 0.0), (-1.0, 2.0, 4.0), (0.0, 0.0, -9.0)])
def test_motion_within_the_image_and_in_depth_is_predicted(motion: tuple[float, ...]) -> None:
    now_mm, before_mm = face_like(), face_like(*motion)
    truth_mm = before_mm - now_mm
    assert rms(changes(before_mm, now_mm) - truth_mm) < 0.12 * rms(truth_mm)
    noisy = changes(before_mm + noise(1, 2.0), now_mm + noise(1, 2.0, seed=1))
    assert rms(noisy - truth_mm) < 0.4


def test_a_neighbour_without_depth_does_not_move() -> None:
    now_mm = face_like()
    assert not changes(torch.zeros_like(now_mm), now_mm).any()
    assert not changes(torch.full_like(now_mm, torch.nan), now_mm).any()


def test_a_step_does_not_count_as_motion() -> None:
    """A head moves in front of a static wall: the predicted motion of the wall is 0."""
    wall_mm = torch.full((1, 1, HEIGHT, WIDTH), 1600.0)
    head = (face_like() < 970.0) & (torch.arange(WIDTH) < 50)
    moved = (face_like(0.0, 1.0) < 970.0) & (torch.arange(WIDTH) < 50)
    now_mm = torch.where(head, face_like(), wall_mm)
    before_mm = torch.where(moved, face_like(0.0, 1.0), wall_mm)
    assert float(changes(before_mm, now_mm)[..., 100:].abs().max()) < 0.01


def test_frames_of_odd_size_are_predicted_too() -> None:
    now_mm, before_mm = face_like()[..., :95, :111], face_like(1.0, 1.0)[..., :95, :111]
    found = changes(before_mm, now_mm)
    assert found.shape == now_mm.shape
    assert rms(found - (before_mm - now_mm)) < 0.12 * rms(before_mm - now_mm)


@pytest.mark.parametrize("sigma_mm", [1.5, 12.0])
def test_the_mean_over_time_removes_noise_of_any_size_from_a_head_that_moves(
    sigma_mm: float,
) -> None:
    """The mean of five frames has 1 / sqrt(5) = 0.45 of the noise of one frame."""
    clean = [face_like(0.4 * n, -0.3 * n, 0.8 * n) for n in range(5)]
    noisy = torch.cat(clean, 1) + noise(5, sigma_mm)
    now_mm, earlier_mm = noisy[:, :1], noisy[:, 1:]
    mean = mean_over_time(earlier_mm, now_mm)
    assert rms(now_mm + mean.offset_mm - clean[0]) < 0.55 * sigma_mm
    assert rms(clean[4] - clean[0]) > 2.0  # what a mean without motion would mix in
    features = neighbour_features(earlier_mm, now_mm + mean.offset_mm, mean)
    still_mm = 10.0 * torch.sinh(features[:, :4])
    own = math.sqrt(1.0 + 0.2)  # the neighbour's noise, and that of the mean
    assert rms(still_mm) == pytest.approx(own * sigma_mm, rel=0.25)


def test_a_nose_that_moves_too_fast_is_not_smeared() -> None:
    """It moves 12 px a frame; if patches were not compared, the error would be 1.7 mm."""
    noisy = torch.cat([face_like(), face_like(12.0), face_like(24.0)], 1) + noise(3, 1.0)
    mean_mm = noisy[:, :1] + mean_over_time(noisy[:, 1:], noisy[:, :1]).offset_mm
    nose = (..., slice(40, 58), slice(50, 62))
    error_mm = (mean_mm - face_like())[nose]
    assert float(error_mm.square().mean().sqrt()) < 1.2
    assert abs(float(error_mm.mean())) < 0.4
