"""Damaged recordings are read, or refused in one line."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from glsim.core.errors import ConfigError, DatasetError
from glsim.data.recordings.recording import open_recording

DEPTH = np.arange(24 * 32, dtype=np.uint16).reshape(24, 32) + np.uint16(600)
YAML = (
    "%YAML:1.0\n---\ncameraMatrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
    "   data: [ 365.4, 0., 254.8, 0., 365.4, 205.4, 0., 0., 1. ]\n"
)


def write_whole(folder: Path, name: str) -> bytes:
    """Write a recording with a file of this name, and return the bytes of that file."""
    if name == "depth.npy":
        np.save(folder / name, np.stack([DEPTH, DEPTH]))
    else:
        image = "depth_0.png" if name.endswith(("toml", "yaml")) else name
        cv2.imwrite(str(folder / image), DEPTH)
    if name == "camera.toml":
        text = "unit_mm = 0.5\nwidth = 32\nheight = 24\nfocal_px = [30.0, 30.0]\n"
        (folder / name).write_text(text)
    if name == "calib_ir.yaml":
        (folder / name).write_text(YAML)
    return (folder / name).read_bytes()


@pytest.mark.parametrize(
    "name", ["depth_0.png", "depth_0.tiff", "depth.npy", "camera.toml", "calib_ir.yaml"]
)
@settings(
    deadline=None,
    max_examples=60,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(at=st.floats(0, 1), length=st.integers(0, 40), new=st.binary(max_size=12))
def test_damage_anywhere_is_read_or_refused(
    tmp_path: Path, name: str, at: float, length: int, new: bytes
) -> None:
    whole = write_whole(tmp_path, name)
    start = int(at * len(whole))
    (tmp_path / name).write_bytes(whole[:start] + new + whole[start + length :] * (length < 40))
    try:
        frames = open_recording(tmp_path).read(2)
    except (ConfigError, DatasetError) as error:
        message = str(error)
    else:
        message = ""
        assert all(frame.noisy_mm.any() for frame in frames)
    assert "\n" not in message
