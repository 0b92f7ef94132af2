"""Frames of a real D435 against the rules of any-depth-camera and of librealsense's filters."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.rect import Rect
from tests.support.stage_harness import frame, layers_of, run_twin

REAL = Path(__file__).resolve().parents[3] / "shared/data/real-cameras/d435_wall_2frames"

pytestmark = pytest.mark.skipif(
    not REAL.is_dir(), reason="needs two frames of a static wall by a D435 in shared/data"
)

#: Focal length times baseline, px mm. Measured: K / n fits every value for K from 626,822.5 to
#: 626,823.0 mm; the recording's file has 390.4315 px and 50.1707 mm, 626,823.1 / 32.
FOCAL_BASELINE_PX_MM = 626822.75 / 32


@pytest.fixture(scope="module")
def depths_mm() -> list[NDArray[np.float64]]:
    """The two frames; 0 = hole."""
    files = [REAL / f"depth_{n}.png" for n in (0, 1)]
    return [cv2.imread(str(file), cv2.IMREAD_UNCHANGED).astype(np.float64) for file in files]


def test_real_depth_is_on_the_lattice_that_is_drawn(
    depths_mm: list[NDArray[np.float64]],
) -> None:
    """Every value of the D435 is one that any_camera_losses makes with its f B and 1/32 px."""
    ramp = frame(width=20000, height=1, window=Rect(0, 0, 20000, 1))
    depth = np.linspace(0.3, 2.2, 20000)[None, :]
    layers = layers_of(depth, np.array([0.0, 0.0, -1.0, 0.0]), ramp)
    p = {"single_share": 0.0, "cluster_share": 0.0, "dark_signal": 0.0, "saturated_signal": 1e6}
    drawn = run_twin(
        "any_camera_losses", layers, ramp, **p, grazing_cosine=0.0, grazing_spread=0.0,
        step_px=1 / 32, focal_baseline_px_mm=FOCAL_BASELINE_PX_MM,
    )["depth"]  # fmt: skip
    made = np.unique(
        np.rint(1000 * run_twin("millimetre_quantise", {"depth": drawn}, ramp)["depth"])
    )
    real = np.unique(depths_mm[0])
    real = real[(real > 310) & (real < 2190)]
    assert len(real) > 800
    assert np.isin(real, made).all(), real[~np.isin(real, made)]
    assert len(made) < 1600  # the ramp has 1900 whole millimetres
