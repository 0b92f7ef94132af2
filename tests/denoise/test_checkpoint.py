"""Checkpoints are written atomically; files that are no checkpoints are refused."""

from __future__ import annotations

import errno
import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from glsim.denoise import checkpoint
from glsim.denoise import load as load_method
from glsim.denoise.inference import load_network
from glsim.errors import DenoiserError, TrainError
from glsim.files.atomic import AtomicFile
from glsim.train.loop import fit
from glsim.train.models.registry import build_model
from glsim.train.recipe import Recipe
from tests.support.eval_scenes import dome, noisy
from tests.support.train_fakes import SIZE, batch_source, recipe

CONTENT: dict[str, Any] = {
    "recipe": {"model": {"kind": "paper_input", "backbone": {"kind": "dncnn", "depth": 2}}},
    "model": {},
    "data": {},
    "progress": {},
    "validation": {},
}


def run(settings: Recipe, folder: Path) -> None:
    fit(settings, batch_source(settings), folder)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    run(recipe(training={"max_epochs": 1}), folder)
    return folder


def test_there_and_back(tmp_path: Path) -> None:
    path = tmp_path / "a.pt"
    checkpoint.save(path, CONTENT | {"model": {"w": torch.arange(3.0)}})
    found = checkpoint.load(path)
    assert torch.equal(found["model"]["w"], torch.arange(3.0))
    assert found["format"] == "glsim-checkpoint"
    assert [p.name for p in tmp_path.iterdir()] == ["a.pt"]


def test_a_full_disk_leaves_the_checkpoint_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "last.pt"
    checkpoint.save(path, CONTENT | {"model": {"w": torch.ones(2)}})

    class Full:
        def write(self, data: bytes) -> int:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        def close(self) -> None:
            pass

    before = AtomicFile.write

    def write(self: AtomicFile, data: bytes) -> int:
        self._file.close()
        self._file = Full()  # type: ignore[assignment]
        return before(self, data)

    monkeypatch.setattr(AtomicFile, "write", write)
    with pytest.raises(TrainError, match=r"No space left.*one before it is whole.*--resume"):
        checkpoint.save(path, CONTENT | {"model": {"w": torch.zeros(2)}})
    with pytest.raises(TrainError, match="there is none before it"):
        checkpoint.save(tmp_path / "other.pt", CONTENT)
    assert torch.equal(checkpoint.load(path)["model"]["w"], torch.ones(2))
    assert [p.name for p in tmp_path.iterdir()] == ["last.pt"], "nothing half is left"


class Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, ("touch evil",)


def test_files_that_are_no_checkpoints(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    good = tmp_path / "good.pt"
    checkpoint.save(good, CONTENT | {"model": {"w": torch.ones(5000)}})
    whole = good.read_bytes()
    cases: dict[str, tuple[bytes | dict[str, Any], str]] = {
        "start.pt": (whole[:5000], "cut short"),
        "half.pt": (whole[: len(whole) // 2], "cut short"),
        "empty.pt": (b"", "cut short"),
        "text.pt": (b"hello, this is no checkpoint at all", "no checkpoint"),
        "evil.pt": (pickle.dumps(Evil()), "code in a file is not run"),
        "weights.pt": ({"layer.weight": torch.ones(2)}, "is no checkpoint of glsim train"),
        "newer.pt": ({"format": "glsim-checkpoint", "version": 9}, "version 9"),
        "part.pt": ({"format": "glsim-checkpoint", "version": 1}, "has no 'recipe'"),
    }
    for name, (content, problem) in cases.items():
        path = tmp_path / name
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            torch.save(content, path)
        with pytest.raises(TrainError, match=problem):
            checkpoint.load(path)
        with pytest.raises(DenoiserError, match=problem):
            load_network(path)
    assert not (tmp_path / "evil").exists()
    with pytest.raises(TrainError, match="no such checkpoint"):
        checkpoint.load(tmp_path / "none.pt")
    with pytest.raises(TrainError, match="cannot be read"):
        checkpoint.load(tmp_path)


def test_a_checkpoint_of_another_network(tmp_path: Path, trained: Path) -> None:
    content = checkpoint.load(trained / "best.pt")
    content["recipe"]["model"]["backbone"]["width"] = 6
    checkpoint.save(tmp_path / "wider.pt", content)
    with pytest.raises(DenoiserError, match="do not fit its recipe"):
        load_network(tmp_path / "wider.pt")
    content["recipe"]["model"] = {"kind": "future"}
    checkpoint.save(tmp_path / "future.pt", content)
    with pytest.raises(DenoiserError, match="future"):
        load_network(tmp_path / "future.pt")


def test_a_checkpoint_denoises_frames_of_any_size(trained: Path) -> None:
    method = load_method(f"mine@{trained / 'best.pt'}")
    for shape in (SIZE, (41, 30)):
        frame = noisy(dome(shape))
        depth_mm, validity = method(frame[None])
        assert depth_mm.dtype == validity.dtype == np.float32
        assert depth_mm.shape == validity.shape == shape
    content = checkpoint.load(trained / "best.pt")
    model = build_model(content["recipe"]["model"])
    model.load_state_dict(content["model"])
    padded = np.pad(frame, [(0, 48 - 41), (0, 32 - 30)])  # to multiples of 16, with holes
    with torch.no_grad():
        expected = model.eval()(torch.from_numpy(padded)[None, None])
    np.testing.assert_allclose(depth_mm, expected.depth_mm[0, 0, :41, :30].numpy(), atol=1e-3)


def test_the_papers_networks_decide_validity_by_half_a_millimetre(tmp_path: Path) -> None:
    paper = {"kind": "paper_input", "backbone": {"kind": "dncnn", "depth": 2, "width": 4}}
    run(recipe(model=paper, loss={"kind": "all_pixels"}), tmp_path)
    denoise = load_network(tmp_path / "best.pt")
    frame = noisy(dome(SIZE))
    depth_mm, validity = denoise(frame, frame > 0)
    assert validity.dtype == np.bool_
    np.testing.assert_array_equal(validity, depth_mm >= 0.5)
    assert not denoise.uncertain
    with pytest.raises(DenoiserError, match="does not predict its uncertainty"):
        denoise.with_uncertainty(frame, frame > 0)


def test_uncertainty_is_a_standard_deviation_in_millimetres(tmp_path: Path) -> None:
    loss = {"kind": "masked", "depth": "gaussian"}
    run(recipe(model={"uncertainty": True}, loss=loss), tmp_path)
    denoise = load_network(tmp_path / "best.pt")
    frame = noisy(dome(SIZE))
    depth_mm, _, sigma_mm = denoise.with_uncertainty(frame, frame > 0)
    assert denoise.uncertain
    assert sigma_mm.shape == SIZE
    assert (sigma_mm > 0).all()
    np.testing.assert_array_equal(depth_mm, denoise(frame, frame > 0)[0])
