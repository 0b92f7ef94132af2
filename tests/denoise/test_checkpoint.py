"""Checkpoints are written atomically; files that are no checkpoints are refused."""

from __future__ import annotations

import errno
import os
import pickle
import resource
import struct
import time
import zipfile
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


def refused(path: Path) -> str:
    """The one-line error of a checkpoint that is not loaded."""
    with pytest.raises(DenoiserError) as error:
        load_network(path)
    assert "\n" not in str(error.value)
    assert len(str(error.value)) < 600
    return str(error.value)


def test_a_flipped_bit_is_noticed(tmp_path: Path, trained: Path) -> None:
    """PyTorch compares no CRC32: nearly every flipped bit used to give other weights."""
    data = (trained / "best.pt").read_bytes()
    whole = checkpoint.load(trained / "best.pt")["model"]
    rng = np.random.default_rng(0)
    noticed = 0
    for at in rng.integers(0, len(data), 60):
        flipped = bytearray(data)
        flipped[at] ^= 1 << int(rng.integers(8))
        (tmp_path / "flipped.pt").write_bytes(flipped)
        try:
            found = checkpoint.load(tmp_path / "flipped.pt")["model"]
        except TrainError:
            noticed += 1
            continue
        assert all(torch.equal(whole[name], found[name]) for name in whole), int(at)
    assert noticed > 30


@pytest.mark.parametrize(
    ("backbone", "problem"),
    [
        ({"kind": "dncnn", "depth": 100_000}, "less than or equal to 512"),
        ({"kind": "dncnn", "width": 10**9}, "less than or equal to 4096"),
        ({"kind": "dncnn", "width": 10**400}, "width"),
        ({"kind": "dncnn", "depth": 500, "width": 4096}, "million weights, more than the 250"),
        ({"kind": "unet", "scales": 8, "width": 4096}, "million weights"),
        ({"kind": "restormer", "blocks": [64, 64, 64, 10**6]}, "blocks"),
        ({"kind": "dncnn", "depth": 20, "width": 1024}, "do not fit its recipe"),
        ({"kind": ["dncnn"]}, "no such kind"),
        ("dncnn", "give a table"),
        ({1: 2, "kind": "dncnn"}, "is no name"),
    ],
)
def test_a_checkpoint_that_asks_for_a_huge_network(
    tmp_path: Path, backbone: object, problem: str
) -> None:
    """53 kB that asked for 100,000 layers took 3.1 GB; width 10^9 was "MemoryError (a bug)"."""
    recipe = {"model": {"kind": "paper_input", "backbone": backbone}}
    checkpoint.save(tmp_path / "huge.pt", CONTENT | {"recipe": recipe})
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    assert problem in refused(tmp_path / "huge.pt")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 200_000  # kB


def test_a_nest_of_wrappers(tmp_path: Path) -> None:
    spec: dict[str, Any] = {"kind": "dncnn"}
    for _ in range(400):
        spec = {"kind": "artifact_removal", "backbone": spec}
    recipe = {"model": {"kind": "paper_input", "backbone": spec}}
    checkpoint.save(tmp_path / "nest.pt", CONTENT | {"recipe": recipe})
    assert "wraps another network, not itself" in refused(tmp_path / "nest.pt")


def test_weights_that_are_no_finite_tensors(tmp_path: Path, trained: Path) -> None:
    content = checkpoint.load(trained / "best.pt")
    name, weight = next((n, w) for n, w in content["model"].items() if w.dim() == 4)
    for value in (float("nan"), float("inf")):
        bad = content["model"] | {name: torch.full_like(weight, value)}
        checkpoint.save(tmp_path / "bad.pt", content | {"model": bad})
        assert "holds NaN or infinity" in refused(tmp_path / "bad.pt")
    endless = torch.zeros(1).expand(10**10)
    checkpoint.save(tmp_path / "bad.pt", content | {"model": {name: endless}})
    assert "larger than the file" in refused(tmp_path / "bad.pt")
    checkpoint.save(tmp_path / "bad.pt", content | {"model": {name: "text"}})
    assert "do not fit its recipe" in refused(tmp_path / "bad.pt")
    for key in ("recipe", "model", "data", "progress", "validation"):
        checkpoint.save(tmp_path / "bad.pt", content | {key: 3})
        assert f"has no '{key}'" in refused(tmp_path / "bad.pt")


def test_archives_that_grow_in_memory(tmp_path: Path, trained: Path) -> None:
    squeezed = tmp_path / "squeezed.pt"
    with zipfile.ZipFile(trained / "best.pt") as old, zipfile.ZipFile(squeezed, "w") as new:
        for name in old.namelist():
            new.writestr(name, old.read(name), zipfile.ZIP_DEFLATED)
    assert "is compressed" in refused(squeezed)
    sparse = tmp_path / "sparse.pt"
    with sparse.open("wb") as file:
        file.truncate(20 << 30)
    assert "21475 MB are more than" in refused(sparse)
    os.mkfifo(tmp_path / "pipe.pt")
    with pytest.raises(DenoiserError, match=r"no such checkpoint|is a pipe"):
        load_method(str(tmp_path / "pipe.pt"))
    with pytest.raises(TrainError, match="is a pipe"):
        checkpoint.load(tmp_path / "pipe.pt")


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000


def write_archive(path: Path, name: str, size: int) -> None:
    """A sparse archive of one uncompressed member of zeros: its list stands behind a hole."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr(name, b"")
    head = path.read_bytes()
    local = 30 + len(name)  # APPNOTE.TXT 4.3.7: the sizes stand at 18, in the list (4.3.12) at 20
    sizes = struct.pack("<II", size, size)
    listed = bytearray(head[local:])
    listed[20:28] = sizes
    listed[-6:-2] = struct.pack("<I", local + size)
    with path.open("wb") as file:
        file.write(head[:18] + sizes + head[26:local])
        file.seek(local + size)
        file.write(listed)
    assert zipfile.ZipFile(path).infolist()[0].file_size == size


@pytest.mark.parametrize("name", ["holes.pt", "holes.safetensors"])
def test_a_sparse_file_of_an_allowed_size(tmp_path: Path, name: str) -> None:
    """One of 4.1 GB took 8.2 GB: its parts, and the whole that was made of them."""
    with (tmp_path / name).open("wb") as file:
        file.truncate(checkpoint.MAX_BYTES - 1)
    before, start = peak_mb(), time.process_time()
    assert "is cut short" in refused(tmp_path / name)
    assert time.process_time() - start < 1
    assert peak_mb() - before < 300


@pytest.mark.parametrize(
    ("member", "size", "problem"),
    [
        ("archive/data/0", 2_000_000_000, "has 2000 MB, more than the 1000"),
        ("archive/data.pkl", 500_000_000, "has 500 MB, more than the 4 of"),
    ],
)
def test_members_that_no_network_needs(
    tmp_path: Path, member: str, size: int, problem: str
) -> None:
    write_archive(tmp_path / "wide.pt", member, size)
    before, start = peak_mb(), time.process_time()
    assert problem in refused(tmp_path / "wide.pt")
    assert time.process_time() - start < 1
    assert peak_mb() - before < 300


def test_an_archive_of_a_million_members(tmp_path: Path) -> None:
    """Each takes 46 bytes of the list, and 600 in memory."""
    path = tmp_path / "many.pt"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("a", b"")
    head = path.read_bytes()
    entry, end = head[31:78], bytearray(head[78:])
    end[12:16] = struct.pack("<I", len(entry) * 1_000_000)
    path.write_bytes(head[:31] + entry * 1_000_000 + end)
    before = peak_mb()
    assert "is no checkpoint" in refused(path)
    assert peak_mb() - before < 300


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
