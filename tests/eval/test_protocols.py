"""Scores under both protocols: measured depth, and the nearest point of each frame at 1 mm."""

import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glsim.core.depth_protocol import DepthProtocol
from glsim.core.errors import ConfigError
from glsim.data.reader import open_dataset
from glsim.eval.report.figures.panels import in_space
from glsim.eval.report.results import example_frame
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.evaluate import Evaluation, evaluate
from tests.support.moved_sets import write_both_protocols, write_domes


class OfThePaper:
    """Stands for a network that was trained under the protocol paper."""

    protocol = "paper"

    def __call__(self, noisy_mm: Any, valid: Any) -> tuple[Any, Any]:
        return noisy_mm, valid


NETWORK = "net@tests.eval.test_protocols:OfThePaper"


@pytest.fixture(scope="module")
def sets(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write_both_protocols(tmp_path_factory.mktemp("sets"))


@pytest.fixture
def folder(sets: dict[str, Path], tmp_path: Path) -> Path:
    """The files of the set at 1 mm, without their records."""
    return Path(shutil.copytree(sets["paper"] / "test", tmp_path / "folder"))


def run(data: Path, out: Path, protocol: DepthProtocol | None, *specs: str) -> Evaluation:
    job = ScoringJob(data, "test", specs or ("noisy",), protocol=protocol)
    return evaluate(job, out, workers=1, baselines=False)


def baseline_mse(data: Path, offset: bool) -> float:
    """The MSE of the input by hand, from the millimetres of the test frames."""
    values = []
    for pair in open_dataset(data).split("test"):
        clean, noisy = (image.astype(np.float64) for image in (pair.clean_mm, pair.noisy_mm))
        by = clean[clean > 0].min() - 1 if offset else 0.0
        moved = [np.where(image > 0, image - by, 0) for image in (clean, noisy)]
        values.append(np.mean((moved[1] - moved[0]) ** 2))
    return float(np.mean(values))


@pytest.mark.parametrize("stored", ["depth", "paper"])
def test_either_protocol_from_either_set(
    sets: dict[str, Path], tmp_path: Path, stored: str
) -> None:
    for protocol, moved in (("depth", False), ("paper", True)):
        found = run(sets[stored], tmp_path / protocol, protocol)  # type: ignore[arg-type]
        wanted = baseline_mse(sets["depth"], moved)
        assert found.summary.mean("noisy", "mse_mm2") == pytest.approx(wanted, rel=1e-5)
        assert found.protocol == protocol
    assert run(sets[stored], tmp_path / "default", None).protocol == stored


def test_surfaces_are_compared_at_their_distance_from_the_camera(
    sets: dict[str, Path], tmp_path: Path
) -> None:
    """Normals of a face that is squeezed into the camera would be others."""
    angles = [
        run(data, tmp_path / f"{stored} {name}", name).summary.mean("noisy", "normal_mean_deg")  # type: ignore[arg-type]
        for stored, data in sets.items()
        for name in ("depth", "paper")
    ]
    assert angles == pytest.approx([angles[0]] * 4, rel=1e-3)
    assert angles[0] > 10
    for stored, data in sets.items():
        bins = run(data, tmp_path / f"{stored} bins", "paper").summary.bias_by_distance("noisy")
        assert {900 <= each.from_mm <= 1000 for each in bins} == {True}


def test_a_plain_folder_at_1_mm_is_scored(folder: Path, tmp_path: Path) -> None:
    """Its distance is not known, so its normals are not either."""
    sets_mse = baseline_mse(write_domes(tmp_path / "d", "depth"), True)
    found = run(folder, tmp_path / "o", None)
    assert (found.protocol, found.bad) == ("paper", 0)
    assert found.summary.mean("noisy", "mse_mm2") == pytest.approx(sets_mse, rel=1e-6)
    assert np.isnan(found.summary.mean("noisy", "normal_mean_deg"))
    assert np.isnan(found.summary.mean("noisy", "normal_good_pct"))
    example = example_frame(ScoringJob(folder, "test", ("noisy",)))
    assert in_space(example[0], example[0].clean_mm).max() > 900
    with pytest.raises(ConfigError, match=r"--protocol depth: the maps in .* have the nearest"):
        run(folder, tmp_path / "p", "depth")


def test_a_network_of_the_other_protocol_is_refused(sets: dict[str, Path], tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"net: was trained under the protocol paper .* depth"):
        run(sets["depth"], tmp_path / "o", None, NETWORK)
    assert run(sets["depth"], tmp_path / "o", "paper", NETWORK).summary.methods == ["net"]
