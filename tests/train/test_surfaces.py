"""Pixels at steps in depth: the network puts them onto one of two surfaces."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from glsim.train.losses import Masked, target_surface
from glsim.train.models.base import Prediction
from glsim.train.models.registry import build_model
from tests.support.networks import BACKBONES

FACE_MM, WALL_MM = 700.0, 1500.0


def test_the_right_surface_is_the_own_one_unless_another_is_clearly_nearer() -> None:
    errors_mm = torch.tensor([[5.0, 1.0, -300.0], [40.0, 16.0, 300.0], [-400.0, 30.0, -20.0]])
    right = target_surface(errors_mm.T[None, :, :, None])  # three pixels, three candidates
    assert right.flatten().tolist() == [0, 0, 2]
    assert target_surface(torch.tensor([60.0, 1.0, 300.0]).view(1, 3, 1, 1)).item() == 1


def test_only_the_right_candidate_is_pulled() -> None:
    clean_mm = torch.full((1, 1, 9, 9), FACE_MM)
    candidates = torch.tensor([FACE_MM + 400, FACE_MM + 3, FACE_MM + 800]).view(1, 3, 1, 1)
    candidates_mm = candidates.expand(1, 3, 9, 9).clone().requires_grad_()
    logits = torch.zeros(1, 3, 9, 9, requires_grad=True)
    prediction = Prediction(
        candidates_mm[:, :1], torch.full((1, 1, 9, 9), 3.0), None, candidates_mm, logits
    )
    total, parts = Masked()(prediction, clean_mm, clean_mm)
    total.backward()
    assert candidates_mm.grad is not None
    assert logits.grad is not None
    pulled = candidates_mm.grad.abs().sum(dim=(0, 2, 3))
    assert pulled[1] > 0
    assert pulled[0] == pulled[2] == 0
    assert parts["choice"].item() == pytest.approx(torch.tensor(3.0).log().item())
    assert (logits.grad[:, 1] < 0).all()
    assert (logits.grad[:, [0, 2]] > 0).all()


def _scene(seed: int) -> tuple[Tensor, Tensor]:
    """Four tilted edges between two planes; the pixels along them are mixtures of both."""
    generator = torch.Generator().manual_seed(seed)
    y, x = torch.meshgrid(torch.arange(32.0), torch.arange(32.0), indexing="ij")
    angle = 6.28 * torch.rand(4, 1, 1, generator=generator)
    shift = 8 * torch.rand(4, 1, 1, generator=generator) - 4
    side = (x - 16) * angle.cos() + (y - 16) * angle.sin() + shift
    clean = torch.where(side > 0, FACE_MM, WALL_MM)
    share = (side / 3 + 0.5).clamp(0, 1)
    mixed = share * FACE_MM + (1 - share) * WALL_MM
    noise = 2 * torch.randn(mixed.shape, generator=generator)
    return (mixed + noise)[:, None], clean[:, None]


def _flying(surfaces: bool) -> float:
    """Pixels per frame in mid-air after a short training."""
    torch.manual_seed(0)
    model = build_model(
        {"kind": "mask_aware", "surfaces": surfaces, "backbone": BACKBONES["small_unet"]}
    )
    optimiser = torch.optim.Adam(model.parameters(), 3e-3)
    loss = Masked(edge_weight=1.0)
    for seed in range(60):
        noisy_mm, clean_mm = _scene(seed)
        total, _ = loss(model(noisy_mm), noisy_mm, clean_mm)
        optimiser.zero_grad()
        total.backward()
        optimiser.step()
    noisy_mm, clean_mm = _scene(1000)
    with torch.no_grad():
        off = (model(noisy_mm).depth_mm - clean_mm).abs() > 50
    return float(off.sum() / len(off))


@pytest.mark.long
def test_choosing_leaves_fewer_pixels_in_mid_air() -> None:
    noisy_mm, clean_mm = _scene(1000)
    before = float(((noisy_mm - clean_mm).abs() > 50).sum() / len(noisy_mm))
    assert before > 60
    choosing = _flying(surfaces=True)
    assert choosing < 0.4 * before
    assert choosing < 0.5 * _flying(surfaces=False)
