"""Self-supervised losses: blind spots, added noise, and the expectations they rest on."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Generator, Tensor

from glsim.train.losses import Recorrupted
from glsim.train.models.base import Prediction

SIGMA_MM = 2.0


def draw(seed: int = 0) -> Generator:
    return torch.Generator().manual_seed(seed)


def frames(seed: int = 0, size: int = 64) -> tuple[Tensor, Tensor]:
    """(4, 1, size, size) noisy and clean: a plane before nothing, with holes."""
    plane = 900 + torch.arange(size).float().expand(4, 1, size, size) * 0.5
    clean = torch.where(torch.arange(size)[:, None] < size // 2, plane, 0.0)
    noise = SIGMA_MM * torch.randn(clean.shape, generator=draw(seed))
    holes = torch.rand(clean.shape, generator=draw(seed + 1)) < 0.1
    return torch.where((clean > 0) & ~holes, clean + noise, 0.0), clean


def identity(noisy_mm: Tensor) -> Prediction:
    return Prediction(noisy_mm)


def test_recorrupted_error_is_that_against_the_clean_depth_plus_a_constant() -> None:
    """The identity that the method rests on, for a network that scales its input."""
    clean = torch.full((64, 1, 32, 32), 900.0)
    noisy = clean + SIGMA_MM * torch.randn(clean.shape, generator=draw(3))
    loss = Recorrupted(sigma_mm=SIGMA_MM, beta_mm=1.0)
    gain = 0.6

    def shrink(noisy_mm: Tensor) -> Prediction:
        return Prediction(900 + gain * (noisy_mm - 900))

    measured = 2 * loss.training_loss(shrink, noisy, clean, draw(4))[0].item()
    input_var = SIGMA_MM**2 * (1 + loss.tau**2)
    target_var = SIGMA_MM**2 * (1 + 1 / loss.tau**2)
    assert measured == pytest.approx(gain**2 * input_var + target_var, rel=0.03)
    # Noise that is larger than assumed leaks from input to target: copying starts to pay.
    assumed = Recorrupted(sigma_mm=SIGMA_MM / 2, beta_mm=1.0)
    leaky = 2 * assumed.training_loss(shrink, noisy, clean, draw(4))[0].item()
    half = (SIGMA_MM / 2) ** 2
    independent = (
        gain**2 * (SIGMA_MM**2 + half * assumed.tau**2) + SIGMA_MM**2 + half / assumed.tau**2
    )
    covariance = SIGMA_MM**2 - half
    assert leaky == pytest.approx(independent - 2 * gain * covariance, rel=0.05)


def test_noise_is_added_to_measured_pixels_only() -> None:
    noisy, _ = frames()
    loss = Recorrupted(sigma_mm=SIGMA_MM)
    added = loss.added_noise_mm(noisy, draw())
    assert (added[noisy == 0] == 0).all()
    assert added[noisy > 0].std().item() == pytest.approx(SIGMA_MM, rel=0.05)
    assert loss.tau == pytest.approx(math.sqrt(0.15 / 0.85))


def test_clean_frames_are_not_seen_and_the_draw_decides() -> None:
    noisy, clean = frames()
    loss = Recorrupted()

    def value(clean_mm: Tensor, seed: int) -> float:
        return loss.training_loss(identity, noisy, clean_mm, draw(seed))[0].item()

    assert value(clean, 1) == value(torch.full_like(clean, math.nan), 1)
    assert value(clean, 1) != value(clean, 2)
    total, parts = loss(identity(noisy), noisy, torch.full_like(clean, math.nan))
    assert total == 0
    assert set(parts) == {"measured"}


def test_a_filter_learns_to_smooth_without_clean_frames() -> None:
    """25 weights in place of a network: the surface's error falls well below the noise."""
    loss = Recorrupted(sigma_mm=2.0)
    weights = torch.zeros(1, 1, 5, 5)
    weights[0, 0, 2, 2] = 1.0
    weights.requires_grad_()

    def filtered(noisy_mm: Tensor) -> Prediction:
        there = (noisy_mm > 0).float()
        relative = (noisy_mm - 900) * there
        total = torch.nn.functional.conv2d(relative, weights, padding=2)
        weight = torch.nn.functional.conv2d(there, weights, padding=2)
        return Prediction(900 + total / weight.clamp_min(0.1))

    optimiser = torch.optim.Adam([weights], 0.02)
    for step in range(60):
        noisy, clean = frames(seed=10 * step)
        total, _ = loss.training_loss(filtered, noisy, clean, draw(5000 + step))
        optimiser.zero_grad()
        total.backward()
        optimiser.step()
    noisy, clean = frames(seed=9999)
    there = noisy > 0
    with torch.no_grad():
        error = (filtered(noisy).depth_mm - clean)[there].std().item()
    assert error < 0.6 * SIGMA_MM
