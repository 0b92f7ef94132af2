"""The classifier, the report, and the command glsim compare."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from glsim.bench.compare.classifier import tell_apart
from glsim.bench.compare.comparison import compare_sets
from glsim.bench.compare.patches import surface_patches
from glsim.cli import main
from glsim.core.depth_frame import Frames
from glsim.core.errors import pip_install
from glsim.core.files.png import read_image
from glsim.data.maps import open_maps
from tests.support.planted_frames import frames_of, noisy, plane, shadowed
from tests.support.real_cameras import REAL_KINECT_V2, needs_real_kinect_v2
from tests.support.recordings import write_frames


def _set(seed: int, sigma_mm: float, smooth: int, frames: int = 6) -> Frames:
    depths = []
    for k in range(frames):
        clean = shadowed(800.0 + 30 * k, 1700.0, 2, 6)
        clean = np.where(clean == 1700.0, plane(1700.0, 0.1), clean)
        depths.append(noisy(clean, sigma_mm, seed + k, smooth))
    return frames_of(f"seed {seed}", depths)


@pytest.mark.long
def test_two_samples_of_one_simulator_cannot_be_told_apart() -> None:
    first, second = (surface_patches(_set(s, 1.2, 3))["planes"] for s in (100, 200))
    verdict = tell_apart(first, second)
    assert verdict.patches > 500
    assert verdict.auc == pytest.approx(0.5, abs=0.06)


@pytest.mark.parametrize(
    ("sigma_mm", "smooth"), [(1.5, 3), pytest.param(1.2, 1, marks=pytest.mark.long)]
)
def test_other_noise_is_told_apart(sigma_mm: float, smooth: int) -> None:
    """Noise of 25 % more, and noise of the same size without correlation."""
    first = surface_patches(_set(100, 1.2, 3))["planes"]
    second = surface_patches(_set(200, sigma_mm, smooth))["planes"]
    verdict = tell_apart(first, second)
    assert verdict.auc > 0.9
    named = "log of the residual" if smooth == 3 else "correlation at 1 px"
    assert any(named in t.feature and t.auc > 0.8 for t in verdict.telling)


def test_other_distances_alone_do_not_tell() -> None:
    """Noise that grows with distance: matched by distance, the sets stay alike."""

    def patches(seed: int, distances: tuple[float, ...]):  # type: ignore[no-untyped-def]
        depths = [noisy(plane(z), z / 800.0, seed + k, 3) for k, z in enumerate(distances)]
        return surface_patches(frames_of("x", depths))["planes"]

    near = patches(1, (700.0, 705.0, 710.0, 1300.0, 1305.0))
    far = patches(50, (702.0, 1301.0, 1302.0, 1303.0, 1304.0))
    assert tell_apart(near, far).auc == pytest.approx(0.5, abs=0.12)


def test_without_scikit_learn_the_measures_are_there(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "sklearn", None)
    said: list[str] = []
    result = compare_sets(_set(100, 1.0, 3, 2), _set(200, 2.0, 3, 2), said.append)
    assert result.rows
    assert "AUC" not in result.as_markdown()
    assert result.summary() == [
        "No patches are classified: the sets are compared by the measures alone."
    ]
    assert any(pip_install("eval") in line for line in said)


def test_too_few_patches_give_no_verdict() -> None:
    few = surface_patches(frames_of("x", [np.zeros((424, 512), np.uint16)]))["planes"]
    verdict = tell_apart(few, few)
    assert np.isnan(verdict.auc)
    assert verdict.patches == 0


def test_a_comparison_says_what_differs() -> None:
    result = compare_sets(_set(100, 1.0, 3, 3), _set(200, 2.0, 3, 3))
    rows = {(row.group, row.name): row for row in result.rows}
    planes = rows["residual of surfaces from a quadric in 7x7", "median"]
    assert planes.change == pytest.approx(2.0, rel=0.1)
    width = rows["silhouettes, shadow side", "width of the gap, mean"]
    assert (width.first, width.change) == (pytest.approx(6.0), pytest.approx(1.0))
    assert not any("infrared" in row.group for row in result.rows)
    tree = json.loads(json.dumps(result.as_json(), allow_nan=False))
    assert tree["classifier"]["planes"]["auc"] > 0.9


def _write(folder: Path, seed: int, frames: int = 2, infrared: bool = False) -> Path:
    clean = shadowed(900.0, 1800.0, 2, 6)
    depths = np.stack([noisy(clean, 1.2, seed + number) for number in range(frames)])
    return write_frames(folder, depths, np.where(depths > 0, 4000, 0) if infrared else None)


def test_the_command_writes_table_and_json(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Sets of unlike numbers of frames, one of them without infrared."""
    first, second = _write(tmp_path / "a", 1, 2, infrared=True), _write(tmp_path / "b", 9, 1)
    files = [tmp_path / name for name in ("t.md", "t.json", "t.png")]
    options = ["-o", files[0], "--json", files[1], "--figure", files[2]]
    assert main(["compare", str(first), str(second), "-q", *map(str, options)]) == 0
    assert "temporal sigma" in files[0].read_text()
    tree = json.loads(files[1].read_text())
    assert tree["first"]["light"] is not None
    assert tree["second"]["light"] is None
    assert len(np.unique(read_image(files[2]))) > 100
    assert main(["compare", str(first), str(second)]) == 0
    assert capsys.readouterr().out.startswith("# a against b")


@pytest.mark.parametrize(
    ("case", "message"),
    [
        ("missing", "no such file or folder"),
        ("empty", "holds no depth maps"),
        ("sizes", "give frames of one camera"),
        ("dark", "no pixel of any frame has depth"),
    ],
)
def test_errors_are_one_line(
    tmp_path: Path, case: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = _write(tmp_path / "good", 1), tmp_path / "bad"
    if case != "missing":
        bad.mkdir()
    dark, small = np.zeros((424, 512), np.uint16), np.ones((100, 100), np.uint16)
    write_frames(bad, {"sizes": [dark, small], "dark": [dark]}.get(case, []))
    assert main(["compare", str(good), str(bad), "-q"]) in (1, 2)
    error = capsys.readouterr().err
    assert error.startswith("glsim: error: ")
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.long
@needs_real_kinect_v2
def test_real_frames_measure_as_in_reality_md(tmp_path: Path) -> None:
    for stem in ("0007", "0008", "0020", "0030_sync", "0050", "0060_sync"):
        for layer in ("depth", "ir"):
            (tmp_path / f"{stem}_{layer}.png").symlink_to(REAL_KINECT_V2 / f"{stem}_{layer}.png")
    frames = open_maps(tmp_path).read()
    result = compare_sets(frames, frames)
    measured = result.first
    assert measured.temporal.pairs == 1
    np.testing.assert_allclose(measured.temporal.correlation[:3], (0.63, 0.30, 0.01), atol=0.07)
    assert measured.light.temporal.floor_mm == pytest.approx(1.05, abs=0.1)
    assert measured.light.temporal.slope_mm == pytest.approx(4600, rel=0.15)
    assert measured.silhouettes.shadow_side == "right"
    assert measured.pattern.alternation_mm[1] < -0.5
    assert measured.pattern.alternation_mm[6] > 0.5
    assert result.verdicts["planes"].auc == pytest.approx(0.5, abs=0.05)
