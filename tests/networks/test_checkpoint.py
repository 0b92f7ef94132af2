"""Checkpoints and safetensors: there and back, atomic, and refused if damaged or foreign."""

import errno
import json
import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors import safe_open

from glsim.cli import main
from glsim.core.errors import DenoiserError, TrainError
from glsim.core.files.atomic import AtomicFile
from glsim.denoise.inference import load_network
from glsim.denoise.registry import load_denoiser
from glsim.networks import checkpoint
from tests.support.eval_scenes import dome, noisy
from tests.support.networks import build, frames, write_checkpoint

CONTENT: dict[str, Any] = {
    "recipe": {"model": {"kind": "paper_input", "backbone": {"kind": "dncnn", "depth": 2}}},
    "model": {"w": torch.arange(3.0)},
    "data": {},
    "progress": {},
    "validation": {},
}


@pytest.fixture(scope="module")
def best(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_checkpoint(tmp_path_factory.mktemp("run") / "best.pt", "surfaces", "small_unet")


def test_a_full_disk_leaves_the_checkpoint_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "last.pt"
    checkpoint.save(path, CONTENT)

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
    assert torch.equal(checkpoint.load(path)["model"]["w"], torch.arange(3.0))
    assert [p.name for p in tmp_path.iterdir()] == ["last.pt"], "nothing half is left"


class Evil:
    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, ("touch evil",)


def test_files_that_are_no_checkpoints(here: Path) -> None:
    nan = {"model": {"w": torch.full((3,), torch.nan)}}
    ours = {"format": "glsim-checkpoint", "version": 1}
    cases: dict[str, tuple[bytes | dict[str, Any], str]] = {
        "text.pt": (b"hello, this is no checkpoint at all", "is no checkpoint"),
        "text.safetensors": (b"hello, this is no checkpoint at all", "is no checkpoint"),
        "evil.pt": (pickle.dumps(Evil()), "is no checkpoint"),
        "weights.pt": ({"layer.weight": torch.ones(2)}, "is no checkpoint of glsim train"),
        "newer.pt": (ours | {"version": 9}, "version 9"),
        "part.pt": (ours, "has no 'recipe'"),
        "nan.pt": (CONTENT | ours | nan, "holds NaN or infinity"),
    }
    for name, (content, problem) in cases.items():
        path = here / name
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            torch.save(content, path)
        with pytest.raises(TrainError, match=problem):
            checkpoint.load(path)
        with pytest.raises(DenoiserError, match=problem):
            load_network(path)
    assert not (here / "evil").exists()
    for place, problem in ((here / "none.pt", "no such"), (here, "cannot be read")):
        with pytest.raises(TrainError, match=problem):
            checkpoint.load(place)


@pytest.mark.parametrize("suffix", [".pt", ".safetensors"])
@settings(max_examples=40)
@given(cut=st.booleans(), place=st.floats(0, 0.999), bit=st.integers(0, 7))
def test_a_damaged_file_is_refused_in_one_line(
    best: Path, suffix: str, cut: bool, place: float, bit: int
) -> None:
    """A flipped bit of a safetensors file, which has no checksum, may give other numbers."""
    whole = best.with_suffix(suffix)
    if not whole.exists():
        checkpoint.export_safetensors(best, whole)
    data = bytearray(whole.read_bytes())
    at = int(place * len(data))
    if cut:
        del data[at:]
    else:
        data[at] ^= 1 << bit
    damaged = best.with_name(f"damaged{suffix}")
    damaged.write_bytes(data)
    if cut:
        with pytest.raises(TrainError, match=r"^[^\n]*$"):
            checkpoint.load(damaged)
        return
    try:
        found = checkpoint.load(damaged)["model"]
    except TrainError:
        return
    if suffix == ".pt":
        expected = checkpoint.load(best)["model"]
        assert all(torch.equal(expected[name], found[name]) for name in expected)


@pytest.mark.parametrize(
    ("backbone", "problem"),
    [
        ({"kind": "dncnn", "depth": 100_000}, "less than or equal to 512"),
        ({"kind": "dncnn", "depth": 20, "width": 8}, "do not fit its recipe"),
        ({"kind": "future"}, "no such kind"),
        ("dncnn", "give a table"),
    ],
)
def test_a_recipe_that_does_not_fit(tmp_path: Path, backbone: object, problem: str) -> None:
    recipe = {"model": {"kind": "paper_input", "backbone": backbone}}
    checkpoint.save(tmp_path / "a.pt", CONTENT | {"recipe": recipe})
    with pytest.raises(DenoiserError, match=problem):
        load_network(tmp_path / "a.pt")


def test_safetensors_hold_the_same_network(
    best: Path, here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["export", str(best), "-o", "out/net.safetensors", "-q"]) == 0
    found, expected = checkpoint.load(Path("out/net.safetensors")), checkpoint.load(best)
    assert {k: v for k, v in found.items() if k != "model"} == {
        k: v for k, v in expected.items() if k != "model"
    }
    assert all(torch.equal(found["model"][k], v) for k, v in expected["model"].items())
    frame = frames(1, 40, 50)[0, 0].numpy()
    by_file, by_checkpoint = (
        load_denoiser(f"{path}:min_probability=0.6")(frame)
        for path in ("out/net.safetensors", best)
    )
    np.testing.assert_array_equal(by_file.depth_mm, by_checkpoint.depth_mm)
    with safe_open("out/net.safetensors", "np") as file:  # other readers
        assert set(file.keys()) == set(expected["model"])
        assert json.loads(file.metadata()["glsim"])["recipe"] == expected["recipe"]
    monkeypatch.setattr("glsim.core.errors.find_spec", lambda name: None)
    with pytest.raises(DenoiserError, match=r"\[train\]"):
        load_denoiser("out/net.safetensors")


def test_a_checkpoint_denoises_frames_of_any_size(best: Path) -> None:
    denoiser = load_denoiser(f"mine@{best}")
    model = build("surfaces", "small_unet").eval()
    for shape in ((24, 24), (41, 30)):
        frame = noisy(dome(shape))
        found = denoiser.estimate(frame[None])
        assert found.depth_mm.shape == found.valid.shape == shape
        assert (found.sigma_mm > 0).all()
        below, right = (-size % 16 for size in shape)  # with holes, to multiples of 16
        padded = np.pad(frame, [(0, below), (0, right)])
        with torch.no_grad():
            expected = model(torch.from_numpy(padded)[None, None]).depth_mm[0, 0].numpy()
        sure = found.valid > 0
        np.testing.assert_allclose(
            found.depth_mm[sure], expected[: shape[0], : shape[1]][sure], atol=1e-3
        )


def test_the_papers_networks_decide_validity_by_half_a_millimetre(tmp_path: Path) -> None:
    path = write_checkpoint(tmp_path / "best.pt", "paper", "dncnn")
    frame = noisy(dome((24, 24)))
    denoiser = load_denoiser(str(path))
    found = denoiser.estimate(frame[None])
    assert found.valid.dtype == np.bool_
    np.testing.assert_array_equal(found.valid, found.depth_mm >= 0.5)
    assert not denoiser.uncertain
    assert found.sigma_mm is None
