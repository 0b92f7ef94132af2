"""Weights as safetensors: there and back, and files that are foreign, damaged or cut short."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors import safe_open
from safetensors.torch import save_file

from glsim.cli import main
from glsim.denoise import checkpoint, load
from glsim.errors import DenoiserError, TrainError
from tests.support.networks import BACKBONES, WRAPPERS, build, frames


@pytest.fixture
def best(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    recipe = {"model": WRAPPERS["surfaces"] | {"backbone": BACKBONES["small_unet"]}}
    content = {"recipe": recipe, "model": build("surfaces", "small_unet").state_dict()}
    more = {"data": {"name": "a"}, "progress": {"steps": 3}, "validation": {"iou": 0.5}}
    checkpoint.save(Path("best.pt"), content | more)
    return Path("best.pt")


def test_the_network_is_the_same(best: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(best), "-o", "out/net.safetensors"]) == 0
    assert "wrote out/net.safetensors" in capsys.readouterr().err
    frame = frames(1, 40, 50)[0, 0].numpy()
    by_file, by_checkpoint = (
        load(f"{path}:min_probability=0.6").denoise_map(frame)
        for path in ("out/net.safetensors", best)
    )
    np.testing.assert_array_equal(by_file.depth_mm, by_checkpoint.depth_mm)
    np.testing.assert_array_equal(by_file.valid, by_checkpoint.valid)
    found, expected = checkpoint.load(Path("out/net.safetensors")), checkpoint.load(best)
    assert {k: v for k, v in found.items() if k != "model"} == {
        k: v for k, v in expected.items() if k != "model"
    }
    assert all(torch.equal(found["model"][k], v) for k, v in expected["model"].items())


def test_other_readers_find_the_weights_and_the_recipe(best: Path) -> None:
    checkpoint.export_safetensors(best, Path("net.safetensors"))
    with safe_open("net.safetensors", "np") as file:
        assert set(file.keys()) == set(checkpoint.load(best)["model"])
        assert file.metadata()["format"] == "pt"
        assert json.loads(file.metadata()["glsim"])["recipe"]["model"]["kind"] == "mask_aware"


def test_a_flipped_bit_is_found_wherever_it_is(best: Path) -> None:
    path = Path("net.safetensors")
    checkpoint.export_safetensors(best, path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    names = whole.index(b"data_offsets")
    for place in (0, 3, 7, 8, names, *rng.integers(9, len(whole), 60)):
        data = bytearray(whole)
        data[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(data)
        with pytest.raises(TrainError, match=r"damaged|has no recipe"):
            checkpoint.load(path)


def test_files_that_hold_no_network_of_ours(best: Path) -> None:
    checkpoint.export_safetensors(best, Path("net.safetensors"))
    whole = Path("net.safetensors").read_bytes()
    weights = checkpoint.load(best)["model"]
    deep = "[" * 100_000
    for name, data, problem in (
        ("empty", b"", "cut short"),
        ("half", whole[: len(whole) // 2], "cut short"),
        ("long", (1 << 62).to_bytes(8, "little") + whole[8:], "cut short"),
        ("zip", best.read_bytes(), "no safetensors file"),
        ("plain", {}, "has no recipe"),
        ("deep", {"glsim": deep}, "no safetensors file"),
        ("list", {"glsim": "[1]"}, "has no recipe"),
        ("other", {"glsim": "{}"}, "is damaged"),
    ):
        path = Path(f"{name}.safetensors")
        if isinstance(data, bytes):
            path.write_bytes(data)
        else:
            save_file(weights, path, data)
        with pytest.raises(TrainError, match=problem):
            checkpoint.load(path)
        with pytest.raises(DenoiserError, match=problem):
            load(str(path))


def test_weights_that_are_no_numbers_are_refused(best: Path) -> None:
    content = checkpoint.load(best)
    name = next(name for name, value in content["model"].items() if value.is_floating_point())
    content["model"][name].reshape(-1)[0] = float("nan")
    from glsim.denoise.safetensors_file import safetensors_bytes

    Path("net.safetensors").write_bytes(safetensors_bytes(content))
    with pytest.raises(TrainError, match="NaN or infinity"):
        checkpoint.load(Path("net.safetensors"))


def test_without_the_package_the_error_says_what_to_install(
    best: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "safetensors.torch", None)
    with pytest.raises(TrainError, match=r"glsim\[train\]"):
        checkpoint.export_safetensors(best, Path("net.safetensors"))
    assert not Path("net.safetensors").exists()
    Path("net.safetensors").write_bytes(b"x")
    with pytest.raises(DenoiserError, match=r"glsim\[train\]"):
        load("net.safetensors")
