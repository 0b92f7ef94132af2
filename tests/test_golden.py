"""Golden frames: noise that no formula covers must not change unnoticed.

``pytest tests/test_golden.py --regenerate`` writes them again after an intended change.
"""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from moderngl import Context
from numpy.typing import NDArray

from tests.support.scenes import face_mesh, frames_of, settings_for

GOLDEN = Path(__file__).parent / "golden"
POSE = {"distance_mm": 900.0, "yaw_deg": 25.0, "pitch_deg": -8.0, "roll_deg": 4.0}

#: Largest difference, mm, and the share of pixels where only one image may have depth.
ATOL_MM, ATOL_SHARE = 1, 0.002


def picture(expected: NDArray[Any], found: NDArray[Any]) -> NDArray[np.uint8]:
    """Show expected, found and their difference (white: more than 1 mm), enlarged four times."""
    largest = max(int(expected.max()), 1)
    off = np.abs(expected.astype(int) - found.astype(int)) > ATOL_MM
    cells = [
        (expected.astype(float) * 255 / largest).astype(np.uint8),
        np.minimum(found.astype(float) * 255 / largest, 255).astype(np.uint8),
        off.astype(np.uint8) * 255,
    ]
    return np.kron(np.hstack(cells), np.ones((4, 4), np.uint8))


@pytest.mark.parametrize("sensor", ["ideal", "kinect-v2", "kinect-v2-fankhauser"])
@pytest.mark.parametrize("layer", ["clean", "noisy"])
def test_frames_are_as_they_were(
    context: Context, request: pytest.FixtureRequest, tmp_path: Path, sensor: str, layer: str
) -> None:
    renderer = str(context.info["GL_RENDERER"])
    settings = settings_for(sensor, seed=1, pose=POSE, output={"crop": 96})
    found = frames_of(context, settings, face_mesh())[0].image(layer).astype(np.uint16)
    file = GOLDEN / f"{sensor}_{layer}.png"
    if request.config.getoption("--regenerate"):
        GOLDEN.mkdir(exist_ok=True)
        cv2.imwrite(str(file), found)
    assert file.exists(), f"{file} is missing: run with --regenerate"
    expected: Any = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    assert expected.dtype == np.uint16
    assert expected.shape == (96, 96)
    if "llvmpipe" not in renderer:
        # On another renderer only the statistics must agree.
        both = (expected > 0) & (found > 0)
        assert both.sum() > 0.97 * (expected > 0).sum()
        assert np.median(np.abs(expected.astype(int) - found)[both]) <= ATOL_MM
        return
    holes = (expected > 0) ^ (found > 0)
    off = (np.abs(expected.astype(int) - found) > ATOL_MM) & ~holes
    if off.any() or holes.mean() > ATOL_SHARE:
        diff = tmp_path / f"{sensor}_{layer}_diff.png"
        cv2.imwrite(str(diff), picture(expected, found))
        pytest.fail(
            f"{file.name}: {off.sum()} pixels differ by more than {ATOL_MM} mm, {holes.sum()} "
            f"have depth in one only: see {diff}"
        )
