"""The sheets of stereo and structured light: they pass, and notice what they are for."""

from __future__ import annotations

from pathlib import Path

import cv2
import moderngl
import numpy as np
import pytest

from glsim.validate import Captures, VirtualCamera, run_checks
from glsim.validate.checks.triangulation import lattice_share
from glsim.validate.report import ValidationReport
from tests.support.real_cameras import REAL_CAMERAS


def report(context: moderngl.Context, sensor: str) -> ValidationReport:
    return run_checks(Captures(VirtualCamera(sensor, context)))


def failed(made: ValidationReport) -> set[str]:
    return {result.check.number for result in made.results if result.state == "FAIL"}


@pytest.mark.parametrize(
    "sensor",
    ["realsense-d435", "realsense-d435-vga", "realsense-d455", "truedepth", "kinect-v1-pattern"],
)
def test_the_sheet_passes(context: moderngl.Context, sensor: str) -> None:
    made = report(context, sensor)
    assert len(made.results) >= 5
    assert not failed(made)


@pytest.mark.parametrize(
    ("change", "rows"),
    [
        ("rim_px = 0\nborder_px = 0", {"7", "8"}),
        ("support_px = 1\nwindow_px = 3", {"1", "2"}),
        ("texture_counts = 6.0", {"10"}),
        ("uniqueness_percent = 40", {"11"}),
        ("depth_unit_mm = 1\ndevice_sigma_px = 0.3\ndevice_grain_px = 2", {"3"}),
    ],
)
def test_the_sheet_notices_another_matcher(
    context: moderngl.Context, tmp_path: Path, change: str, rows: set[str]
) -> None:
    file = tmp_path / "other.toml"
    file.write_text(
        f'extends = "realsense-d435"\ntitle = "t"\n[[stage]]\nuse = "match_stereo"\n{change}\n'
    )
    assert failed(report(context, str(file))) >= rows


def test_real_depths_lie_on_the_lattice() -> None:
    frame = REAL_CAMERAS / "d435_wall_2frames" / "depth_0.png"
    if not frame.is_file():
        pytest.skip(f"{frame}: the real frames are not here")
    depth = cv2.imread(str(frame), cv2.IMREAD_UNCHANGED).astype(np.float64)
    assert lattice_share(depth, 626_823, 1.0) > 0.999  # few halves are rounded the other way
    assert lattice_share(depth, 600_000, 1.0) < 0.9
