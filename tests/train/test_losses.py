"""Losses: the surface that is right at a step, losses without clean frames; photographs."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from glsim.core.errors import ConfigError
from glsim.train.data.stored import Photographs
from glsim.train.losses import Masked, build_loss, target_surface
from glsim.train.models.base import Prediction
from glsim.train.recipe import load_recipe
from glsim.train.step_cost import step_flop


@pytest.fixture
def noisy_mm() -> torch.Tensor:
    """Frames of 900 mm with noise of 2 mm, a third of them holes."""
    torch.manual_seed(0)
    return (900 + 2 * torch.randn(4, 1, 96, 96)) * (torch.rand(4, 1, 96, 96) > 0.33)


def test_blind_spots_take_the_depth_of_a_neighbour(noisy_mm: torch.Tensor) -> None:
    changed, target = build_loss({"kind": "noise2void", "radius_px": 1}).batch(noisy_mm, noisy_mm)
    spots = target != 0
    assert spots.float().mean().item() == pytest.approx(0.0156 * 0.67, rel=0.25)
    assert torch.equal(target[spots], noisy_mm[spots])
    assert torch.equal(changed[~spots], noisy_mm[~spots])
    for n, _, y, x in torch.nonzero(spots)[:50].tolist():
        near = noisy_mm[n, 0, max(y - 1, 0) : y + 2, max(x - 1, 0) : x + 2]
        assert changed[n, 0, y, x] in near[(near > 0) & (near != noisy_mm[n, 0, y, x])]


def test_recorrupted_input_and_target_have_independent_noise(noisy_mm: torch.Tensor) -> None:
    changed, target = build_loss({"kind": "recorrupted"}).batch(noisy_mm, noisy_mm)
    seen = noisy_mm > 0
    assert torch.equal(seen, target != 0)
    assert abs(torch.corrcoef(torch.stack([changed[seen], target[seen]]))[0, 1].item()) < 0.02
    assert target[seen].std().item() == pytest.approx(2 * (1 + 0.85 / 0.15) ** 0.5, rel=0.03)


def test_the_next_frame_is_the_target_of_those_before_it(noisy_mm: torch.Tensor) -> None:
    loss, video_mm = build_loss({"kind": "selfredepth"}), noisy_mm.view(1, 4, 96, 96)
    earlier_mm, target_mm = loss.batch(video_mm, noisy_mm)
    assert torch.equal(earlier_mm[:, :3], video_mm[:, 1:])
    assert not earlier_mm[:, 3].any()
    assert torch.equal(target_mm, video_mm[:, :1] * (video_mm[:, 1:2] > 0))
    with pytest.raises(ConfigError, match=r"set model\.before"):
        loss.batch(noisy_mm, noisy_mm)


def test_priors_weigh_roughness_against_the_measured_depth() -> None:
    loss, full = build_loss({"kind": "sterzentsenko"}), 900 + 2 * torch.randn(1, 1, 32, 32)
    flat = Prediction(torch.full_like(full, 900.0))
    (copy, of_copy), (smooth, of_smooth) = (loss(x, full, full) for x in (Prediction(full), flat))
    assert of_copy["input"] == of_smooth["smooth"] == 0
    assert 0 < smooth < copy


def test_operations_of_a_step_are_those_of_its_convolutions() -> None:
    """Two for each weight and pixel, three times; the first layer's input needs no gradient."""
    weights = 9 * (16 + 5 * 16 * 16 + 16)
    wanted = 2 * (3 * weights - 9 * 16) * 128 * 128 * 4
    assert step_flop(load_recipe("paper-d7-small")) == pytest.approx(wanted, rel=1e-3)


def test_photographs_are_cut_and_get_noise(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "a.png"), np.full((40, 200, 3), 128, np.uint8))
    pictures = Photographs(tmp_path, 48, 1)
    noisy, clean = pictures[0]
    assert (clean.shape, float(clean.mean())) == ((1, 48, 48), 129)
    assert float((noisy - clean).std()) == pytest.approx(25, rel=0.05)
    pictures.set_epoch(1)
    assert not torch.equal(noisy, pictures[0][0])


def test_the_right_surface_is_the_own_one_unless_another_is_clearly_nearer() -> None:
    errors_mm = torch.tensor([[5.0, 1.0, -300.0], [40.0, 16.0, 300.0], [-400.0, 30.0, -20.0]])
    right = target_surface(errors_mm.T[None, :, :, None])  # three pixels, three candidates
    assert right.flatten().tolist() == [0, 0, 2]
    assert target_surface(torch.tensor([60.0, 1.0, 300.0]).view(1, 3, 1, 1)).item() == 1


def test_only_the_right_candidate_is_pulled() -> None:
    clean_mm = torch.full((1, 1, 9, 9), 700.0)
    candidates = torch.tensor([700.0 + 400, 700.0 + 3, 700.0 + 800]).view(1, 3, 1, 1)
    candidates_mm = candidates.expand(1, 3, 9, 9).clone().requires_grad_()
    logits = torch.zeros(1, 3, 9, 9, requires_grad=True)
    prediction = Prediction(
        candidates_mm[:, :1], torch.full((1, 1, 9, 9), 3.0), None, candidates_mm, logits
    )
    total, parts = Masked()(prediction, clean_mm, clean_mm)
    total.backward()
    pulled = candidates_mm.grad.abs().sum(dim=(0, 2, 3))
    assert pulled[1] > 0
    assert pulled[0] == pulled[2] == 0
    assert parts["choice"].item() == pytest.approx(torch.tensor(3.0).log().item())
    assert (logits.grad[:, 1] < 0).all()
    assert (logits.grad[:, [0, 2]] > 0).all()
