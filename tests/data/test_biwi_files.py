"""Depth files and calibrations of Biwi: round trips, damaged files, the real set."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as quick
from hypothesis import strategies as st

from glsim.core.camera import Intrinsics
from glsim.core.errors import DatasetError
from glsim.data.recordings.biwi import read_calibration, read_depth_bin
from tests.support.face_sets import CALIBRATION, depth_bytes, put


@quick(max_examples=60)
@given(st.integers(1, 9), st.integers(1, 7), st.randoms(use_true_random=False))
def test_depth_round_trip(
    tmp_path_factory: pytest.TempPathFactory, width: int, height: int, random: object
) -> None:
    rng = np.random.default_rng(random.randrange(1000))  # type: ignore[attr-defined]
    depth = rng.integers(1, 5000, (height, width)).astype(np.uint16)
    depth[rng.random((height, width)) < 0.5] = 0
    path = tmp_path_factory.mktemp("d") / "frame_depth.bin"
    path.write_bytes(depth_bytes(depth))
    np.testing.assert_array_equal(read_depth_bin(path), depth)


@pytest.mark.parametrize("words", [
    (), (2**31 - 1, 2**31 - 1), (0, 5), (2, 2, -1, 5), (2, 2, 0, 0), (2, 2, 3, 2), (2, 2, 0, 4),
    (2, 2, 2, 0), (2, 2, 4, 0, 7), (2, 2, 2, 2, -5),
])  # fmt: skip
def test_damaged_depth_is_named(tmp_path: Path, words: tuple[int, ...]) -> None:
    data = np.array(words, "<i4").tobytes() or b"123"
    with pytest.raises(DatasetError, match=r"frame_depth\.bin: is no depth file"):
        read_depth_bin(put(tmp_path / "frame_depth.bin", data))


def test_calibration(tmp_path: Path) -> None:
    path = put(tmp_path / "depth.cal", CALIBRATION)
    assert read_calibration(path) == Intrinsics(640, 480, 575.816, 575.816, 320.5, 240.5)
    with pytest.raises(DatasetError, match="26 numbers, not 27"):
        read_calibration(put(path, CALIBRATION.replace(b"640 ", b"")))
    with pytest.raises(DatasetError, match="no plain pinhole"):
        read_calibration(put(path, CALIBRATION.replace(b"0 0 0 0", b"1 0 0 0")))
