"""Losses against a second capture: motion, holes, validity, priors; a filter learns from them."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from torch import Generator, Tensor

from glsim.errors import ConfigError
from glsim.train.losses.registry import build_loss
from glsim.train.losses.second_capture import MultiView, Noise2Noise, still_pixels
from glsim.train.losses.surface_priors import inverse_huber, normal_smoothness
from glsim.train.models.base import Prediction
from glsim.train.models.registry import build_model
from glsim.train.recipe import load_recipe

SIGMA_MM = 2.0
KINDS = ("noise2noise", "multi_view")


def draw(seed: int = 0) -> Generator:
    return torch.Generator().manual_seed(seed)


def surface(size: int = 48) -> Tensor:
    """(2, 1, size, size) mm: a slope of 0.4 mm per pixel in the lower half, nothing above."""
    slope = 900 + 0.4 * torch.arange(size).float().expand(2, 1, size, size)
    return torch.where(torch.arange(size)[:, None] >= size // 2, slope, 0.0)


def capture(seed: int, clean_mm: Tensor | None = None, holes: float = 0.1) -> Tensor:
    clean_mm = surface() if clean_mm is None else clean_mm
    noise = SIGMA_MM * torch.randn(clean_mm.shape, generator=draw(seed))
    lost = torch.rand(clean_mm.shape, generator=draw(seed + 1)) < holes
    return torch.where((clean_mm > 0) & ~lost, clean_mm + noise, 0.0)


def value(loss: Any, depth_mm: Tensor, noisy_mm: Tensor, second_mm: Tensor) -> float:
    total, _ = loss.training_loss(lambda _: Prediction(depth_mm), noisy_mm, second_mm, draw())
    return float(total)


def test_one_flying_pixel_is_not_motion() -> None:
    flat = torch.full((1, 1, 15, 15), 900.0)
    flying = flat.clone()
    flying[0, 0, 7, 7] = 1400
    assert still_pixels(flat, flying, 2.0).all()


def test_where_only_one_capture_measured_nothing_is_known_to_be_still() -> None:
    first, second = torch.zeros(1, 1, 20, 40), torch.zeros(1, 1, 20, 40)
    second[..., :10] = 900
    still = still_pixels(first, second, 2.0)
    assert not still[..., :10].any()
    assert still[..., 20:].all(), "empty in both"


@pytest.mark.parametrize("kind", KINDS)
def test_the_true_surface_beats_the_input_and_the_bias_of_a_shift_is_seen(kind: str) -> None:
    """The error against a second capture is that against the clean depth plus a constant."""
    loss = build_loss({"kind": kind, "beta_mm": 1000.0})
    if isinstance(loss, MultiView):
        loss = loss.model_copy(update={"input_weight": 0.0, "smooth_weight": 0.0})
    noisy, second = capture(1, holes=0), capture(100, holes=0)
    there = noisy > 0
    errors = [
        value(loss, torch.where(there, depth, 0.0), noisy, second)
        for depth in (surface(), noisy, surface() + 1.0)
    ]
    scale = 2 * 1000**2 / getattr(loss, "capture_weight", 1.0)
    true, copied, shifted = (scale * error for error in errors)
    assert true == pytest.approx(SIGMA_MM**2, rel=0.1)
    assert copied == pytest.approx(2 * SIGMA_MM**2, rel=0.1)
    assert shifted - true == pytest.approx(1.0, abs=0.25)


@pytest.mark.parametrize("kind", KINDS)
def test_holes_and_moved_pixels_have_no_gradient(kind: str) -> None:
    noisy, second = capture(1), capture(100)
    second = torch.where((torch.arange(48) >= 24) & (second > 0), second + 30, second)
    depth = noisy.clone().requires_grad_()
    loss = build_loss({"kind": kind})
    if isinstance(loss, MultiView):
        loss = loss.model_copy(update={"input_weight": 0.0, "smooth_weight": 0.0})
    loss.training_loss(lambda _: Prediction(depth), noisy, second, draw())[0].backward()
    assert depth.grad is not None
    assert depth.grad.isfinite().all()
    assert not depth.grad[noisy == 0].any()
    assert not depth.grad[second == 0].any()
    assert not depth.grad[..., 30:].any()
    used = (noisy > 0) & (second > 0)
    assert (depth.grad[..., :20] != 0)[used[..., :20]].float().mean() > 0.99


def test_a_network_with_a_validity_learns_to_fill_and_when() -> None:
    """Holes near measured pixels have a target; logits learn the share of frames with depth."""
    noisy, second = capture(1, holes=0.3), capture(100, holes=0.3)
    depth = torch.full_like(noisy, 900.0).requires_grad_()
    logit = torch.zeros_like(noisy).requires_grad_()
    loss = Noise2Noise(valid_weight=1.0, reach_px=2)
    total, parts = loss.training_loss(lambda _: Prediction(depth, logit), noisy, second, draw())
    total.backward()
    assert set(parts) == {"second", "valid"}
    assert depth.grad is not None
    assert logit.grad is not None
    filled = (noisy == 0) & (second > 0)
    assert (depth.grad != 0)[filled].float().mean() > 0.9
    inside, empty = logit.grad[:, :, 30:], logit.grad[:, :, :15]
    share = 0.5 - inside.sum() / (inside != 0).sum() / empty.max()  # empty.max(): of sigmoid - 0
    assert share == pytest.approx(0.5 - (0.5 - 0.7) / 0.5, abs=0.05)
    assert (empty > 0).all(), "where no frame has depth, its probability falls"


def test_inverse_huber_by_hand() -> None:
    error = torch.tensor([0.5, -1.0, 5.0, 99.0]).view(1, 1, 1, 4)
    mask = torch.tensor([True, True, True, False]).view(1, 1, 1, 4)
    expected = (0.5 + 1.0 + (25 + 1) / 2) / 3
    assert inverse_huber(error, mask).item() == pytest.approx(expected)
    assert inverse_huber(torch.zeros(1, 1, 3, 3), torch.ones(1, 1, 3, 3) > 0) == 0


def test_planes_are_smooth_and_a_fold_costs_its_angle() -> None:
    size, focal_px = 24, 365.456
    columns = torch.arange(size).float().expand(1, 1, size, size)
    pitch_mm = 900 / focal_px
    every = torch.ones(1, 1, size, size, dtype=torch.bool)
    plane = 900 + 0.5 * pitch_mm * columns
    assert normal_smoothness(plane, every, focal_px) < 1e-4
    step = torch.where(columns < 12, 900.0, 1200.0)
    apart = every & (columns != 11) & (columns != 12)
    assert normal_smoothness(step, every, focal_px) > 0.05
    assert normal_smoothness(step, apart, focal_px) < 1e-6, "two planes with a gap between"
    rough = 900 + 2 * torch.randn(1, 1, size, size, generator=draw())
    slopes = 2 * 2**0.5 / (2 * pitch_mm)  # of each axis, standard deviation
    cost = normal_smoothness(rough, every, focal_px).item()
    assert 0.5 * slopes**2 * 0.4 < cost < 2 * slopes**2


def test_priors_reach_the_prediction_and_not_its_holes() -> None:
    noisy, second = capture(1), capture(100)
    depth = (noisy + torch.randn(noisy.shape, generator=draw(9))).requires_grad_()
    loss = MultiView(capture_weight=0.0, input_weight=1.0, smooth_weight=1.0)
    total, parts = loss.training_loss(lambda _: Prediction(depth), noisy, second, draw())
    total.backward()
    assert set(parts) == {"second", "input", "smooth"}
    assert all(part.isfinite() for part in parts.values())
    assert depth.grad is not None
    assert depth.grad.isfinite().all()
    assert not depth.grad[noisy == 0].any()
    assert depth.grad[noisy > 0].any()


@pytest.mark.parametrize("kind", KINDS)
def test_frames_without_depth_have_no_loss_and_validation_ignores_clean(kind: str) -> None:
    loss = build_loss({"kind": kind})
    empty = torch.zeros(1, 1, 16, 16)
    depth = empty.clone().requires_grad_()
    total, _ = loss.training_loss(lambda _: Prediction(depth), empty, empty, draw())
    assert total == 0
    noisy = capture(1)
    total, parts = loss(Prediction(noisy), noisy, torch.full_like(noisy, math.nan))
    assert total == 0
    assert set(parts) == {"measured"}


@pytest.mark.parametrize(
    ("model", "table"),
    [
        (
            {"kind": "masked_depth", "backbone": {"kind": "partial_autoencoder", "width": 4}},
            {"kind": "multi_view"},
        ),
        pytest.param(
            {"kind": "mask_aware", "backbone": {"kind": "small_unet", "width": 6, "scales": 2}},
            {"kind": "noise2noise", "valid_weight": 20.0},
            marks=pytest.mark.long,
        ),
    ],
)
def test_a_small_network_learns_to_smooth_without_clean_frames(
    model: dict[str, Any], table: dict[str, Any]
) -> None:
    torch.manual_seed(0)
    network, loss = build_model(model), build_loss(table)
    optimiser = torch.optim.Adam(network.parameters(), 1e-2)
    clean = surface(24)
    for step in range(80):
        first, second = capture(10 * step, clean), capture(10 * step + 5, clean)
        total, _ = loss.training_loss(network, first, second, draw())
        optimiser.zero_grad()
        total.backward()
        optimiser.step()
    noisy = capture(99_990, clean)
    with torch.no_grad():
        prediction = network.eval()(noisy)
    there = noisy > 0
    error_mm = (prediction.depth_mm - clean)[there]
    assert error_mm.square().mean().sqrt() < 0.85 * SIGMA_MM
    assert error_mm.mean().abs() < 0.5
    if prediction.valid_logit is not None:
        kept = prediction.valid_logit > 0
        closed = ((clean > 0) & (noisy == 0) & kept).sum() / ((clean > 0) & (noisy == 0)).sum()
        assert closed > 0.5, "random holes close"
        assert not kept[:, :, :9].any()


def test_recipes_say_what_they_are_and_bad_tables_are_refused() -> None:
    for name in ("selfredepth-small", "sterzentsenko-small"):
        recipe = load_recipe(name)
        assert recipe.size == "small"
        assert "after " in recipe.title
        assert "instead of" in recipe.description
        assert recipe.training.monitor == "interior_rmse_mm"
        assert recipe.training.precision == "32-true"
    assert load_recipe("sterzentsenko-small").model["backbone"]["kind"] == "partial_autoencoder"
    with pytest.raises(ConfigError, match="frames_apart"):
        build_loss({"kind": "noise2noise", "frames_apart": 0})
