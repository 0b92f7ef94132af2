"""At a step in depth, the loss changes only the candidate surface that is right at a pixel."""

import pytest
import torch

from glsim.train.losses import Masked, target_surface
from glsim.train.models.base import Prediction

FACE_MM = 700.0


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
    pulled = candidates_mm.grad.abs().sum(dim=(0, 2, 3))
    assert pulled[1] > 0
    assert pulled[0] == pulled[2] == 0
    assert parts["choice"].item() == pytest.approx(torch.tensor(3.0).log().item())
    assert (logits.grad[:, 1] < 0).all()
    assert (logits.grad[:, [0, 2]] > 0).all()
