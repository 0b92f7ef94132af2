"""Self-supervised losses: blind spots, added noise, and the expectations they rest on."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch
from torch import Generator, Tensor

from glsim.errors import ConfigError
from glsim.train.losses.base import Loss
from glsim.train.losses.registry import build_loss
from glsim.train.losses.self_supervised import Noise2Void, Recorrupted, blind_spots
from glsim.train.models.base import Prediction
from glsim.train.recipe import load_recipe

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


def test_hidden_pixels_hold_a_measured_neighbour() -> None:
    noisy, _ = frames()
    spots = blind_spots(noisy, 0.2, 2, draw())
    image, _, rows, columns = torch.nonzero(spots.mask, as_tuple=True)
    assert len(image) == pytest.approx(0.2 * (noisy > 0).sum().item(), rel=0.1)
    for b, r, c in zip(image.tolist(), rows.tolist(), columns.tolist(), strict=True):
        square = noisy[b, 0, max(r - 2, 0) : r + 3, max(c - 2, 0) : c + 3]
        value = spots.noisy_mm[b, 0, r, c]
        assert value > 0
        assert value != noisy[b, 0, r, c]
        assert (square == value).any()
    assert torch.equal(spots.noisy_mm[~spots.mask], noisy[~spots.mask])
    assert (noisy[spots.mask] > 0).all()


def test_replacements_come_from_all_of_the_neighbourhood_alike() -> None:
    """A 3 x 3 square of known values: each of the eight neighbours one time in eight."""
    image = torch.arange(1.0, 10.0).reshape(1, 1, 3, 3).repeat(4000, 1, 1, 1)
    spots = blind_spots(image, 0.5, 1, draw())
    middle = spots.noisy_mm[:, 0, 1, 1][spots.mask[:, 0, 1, 1]]
    counts = torch.bincount(middle.long(), minlength=10)
    assert counts[5] == counts[0] == 0
    rest = counts[[1, 2, 3, 4, 6, 7, 8, 9]].double()
    chi2 = ((rest - rest.mean()) ** 2 / rest.mean()).sum().item()
    assert chi2 < 29.9  # 7 degrees of freedom, one in 10,000


def test_a_lonely_pixel_cannot_be_hidden() -> None:
    image = torch.zeros(1, 1, 9, 9)
    image[0, 0, 4, 4] = 900
    spots = blind_spots(image, 0.999, 2, draw())
    assert torch.equal(spots.noisy_mm, image)
    assert not spots.mask.any()
    total, _ = Noise2Void().training_loss(identity, image, image, draw())
    assert total == 0


def test_the_blind_spot_makes_the_identity_the_worse_answer() -> None:
    """Copying costs the difference of two noises; the true surface costs one noise."""
    noisy, clean = frames()
    loss = Noise2Void(share=0.3, beta_mm=1000)

    def surface(_: Tensor) -> Prediction:
        return Prediction(clean)

    copied, known = (
        loss.training_loss(model, noisy, torch.zeros_like(clean), draw(99))[0].item() * 2 * 1000**2
        for model in (identity, surface)
    )
    assert known == pytest.approx(SIGMA_MM**2, rel=0.1)
    assert copied > 1.8 * known


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


@pytest.mark.parametrize("loss", [Noise2Void(), Recorrupted()], ids=lambda loss: str(loss.kind))
def test_clean_frames_are_not_seen_and_the_draw_decides(loss: Loss) -> None:
    noisy, clean = frames()

    def value(clean_mm: Tensor, seed: int) -> float:
        return loss.training_loss(identity, noisy, clean_mm, draw(seed))[0].item()

    assert value(clean, 1) == value(torch.full_like(clean, math.nan), 1)
    assert value(clean, 1) != value(clean, 2)
    total, parts = loss(identity(noisy), noisy, torch.full_like(clean, math.nan))
    assert total == 0
    assert set(parts) == {"measured"}


@pytest.mark.parametrize(
    "table", [{"kind": "noise2void"}, {"kind": "recorrupted", "sigma_mm": 2.0}]
)
def test_a_filter_learns_to_smooth_without_clean_frames(table: dict[str, Any]) -> None:
    """25 weights in place of a network: the surface's error falls well below the noise."""
    loss = build_loss(table)
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


def test_recipes_and_bad_tables() -> None:
    for name in ("noise2void-small", "recorrupted-small"):
        recipe = load_recipe(name)
        assert recipe.size == "small"
        assert build_loss(recipe.loss).model_fields_set
        assert recipe.training.monitor == "interior_rmse_mm"
        assert not recipe.model["uncertainty"], "no loss teaches it"
    with pytest.raises(ConfigError, match=r"no such kind 'noise2viod'.*'noise2void'"):
        build_loss({"kind": "noise2viod"})
    with pytest.raises(ConfigError, match="share"):
        build_loss({"kind": "noise2void", "share": 1.5})
