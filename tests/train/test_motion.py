"""The mean over time of frames of a head that moves."""

import math

import pytest
import torch
from torch import Tensor

from glsim.train.models.extra_features import mean_over_time, neighbour_features

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
