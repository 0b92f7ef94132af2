"""Photographs as depth: the mapping of grey levels, the noise, the order, and what is refused."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from glsim.errors import ConfigError, DatasetError
from glsim.train.data.photograph_files import (
    BUNDLED,
    Photograph,
    find_photographs,
    read_photographs,
    split_photographs,
)
from glsim.train.data.photographs import DepthSpan, PhotographPairs, measure_span

SPAN = DepthSpan(850.0, 160.0)
SIDE = 32


def ramp(name: str = "ramp") -> Photograph:
    """Grey levels 0 to 255 from left to right."""
    return Photograph(name, np.tile(np.arange(256, dtype=np.uint8), (256, 1)))


def write(folder: Path, count: int, side: int = 64) -> Path:
    folder.mkdir(exist_ok=True)
    rng = np.random.default_rng(0)
    for number in range(count):
        image = rng.integers(0, 256, (side, side, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / f"{number}.png"), image)
    return folder


def test_grey_levels_are_depths_of_a_head() -> None:
    pairs = PhotographPairs([ramp()], SPAN, 0.0, side=256, length=4, seed=1)
    for noisy_mm, clean_mm in (pairs[n] for n in range(4)):
        assert noisy_mm.shape == clean_mm.shape == (1, 256, 256)
        assert noisy_mm.dtype == torch.float32
        assert float(clean_mm.min()) == 850.0
        assert float(clean_mm.max()) == pytest.approx(1010.0)
        assert torch.equal(noisy_mm, clean_mm)
    lefts = {round(float(pairs[n][1][0, 0, 0])) for n in range(4)}
    assert lefts == {850, 1010}  # mirrored at random


def test_the_noise_is_gaussian_in_the_same_units() -> None:
    pairs = PhotographPairs([ramp()], SPAN, 25.0, side=128, length=8, seed=1)
    error = torch.cat([noisy - clean for noisy, clean in (pairs[n] for n in range(8))]).numpy()
    sigma_mm = 25.0 / 255 * 160.0
    assert error.std() == pytest.approx(sigma_mm, rel=0.01)
    assert abs(error.mean()) < 5 * sigma_mm / np.sqrt(error.size)
    assert np.mean(np.abs(error) < sigma_mm) == pytest.approx(0.6827, abs=0.01)


def test_the_same_seed_epoch_and_number_give_the_same_pair() -> None:
    def pair(seed: int, epoch: int, number: int) -> torch.Tensor:
        pairs = PhotographPairs([ramp()], SPAN, 10.0, side=SIDE, length=9, seed=seed)
        pairs.set_epoch(epoch)
        return pairs[number][0]

    assert torch.equal(pair(1, 2, 3), pair(1, 2, 3))
    for other in ((2, 2, 3), (1, 3, 3), (1, 2, 4)):
        assert not torch.equal(pair(1, 2, 3), pair(*other))


def test_noise_makes_no_holes_in_faces_at_1_mm() -> None:
    pairs = PhotographPairs([ramp()], DepthSpan(1.0, 160.0), 50.0, side=128, length=2, seed=0)
    assert all(float(image.min()) > 0 for n in range(2) for image in pairs[n])


def test_the_span_is_that_of_the_middle_head() -> None:
    maps = []
    for near in (800.0, 860.0, 990.0):
        depth = torch.zeros(1, 40, 50)
        depth[0, 10:30, 10:40] = torch.linspace(near, near + 150, 600).reshape(20, 30)
        maps.append(depth)
    span = measure_span([*maps, torch.zeros(1, 40, 50)])
    assert span.near_mm == 860.0
    assert span.span_mm == pytest.approx(150 * 0.99, abs=0.5)
    with pytest.raises(DatasetError, match="no clean map has depth"):
        measure_span([torch.zeros(1, 4, 4)])


@pytest.mark.parametrize("count", [2, 3, 5, 11])
def test_validation_has_photographs_of_its_own(count: int) -> None:
    photographs = [ramp(str(n)) for n in range(count)]
    train, held_out = split_photographs(photographs)
    assert train
    assert held_out
    assert {p.name for p in train} | {p.name for p in held_out} == {p.name for p in photographs}
    assert len(train) + len(held_out) == count


def test_folders_are_read_in_grey_and_large_ones_cut(tmp_path: Path) -> None:
    write(tmp_path / "photos", 2)
    cv2.imwrite(str(tmp_path / "photos" / "wide.jpg"), np.full((600, 900, 3), 90, np.uint8))
    photographs = read_photographs(find_photographs(str(tmp_path / "photos")), SIDE)
    assert [p.grey.shape for p in photographs] == [(64, 64), (64, 64), (512, 512)]
    assert (np.abs(photographs[2].grey.astype(int) - 90) <= 1).all()
    with pytest.raises(DatasetError, match=r"0\.png: is smaller than 128 x 128"):
        read_photographs(find_photographs(str(tmp_path / "photos")), 128)
    (tmp_path / "photos" / "0.png").write_bytes(b"no image")
    with pytest.raises(DatasetError, match=r"0\.png: cannot be read"):
        read_photographs(find_photographs(str(tmp_path / "photos")), SIDE)
    with pytest.raises(ConfigError, match="holds 0 images"):
        find_photographs(str(tmp_path / "none"))


def test_scikit_image_has_its_photographs_in_its_wheel(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files of the package itself: nothing is downloaded."""
    pytest.importorskip("skimage")
    photographs = read_photographs(find_photographs(BUNDLED), 128)
    assert len(photographs) == 11
    assert all(p.grey.std() > 5 for p in photographs)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match="pip install scikit-image"):
        find_photographs(BUNDLED)
