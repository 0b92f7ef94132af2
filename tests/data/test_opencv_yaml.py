"""Matrices of OpenCV's YAML files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.core.errors import DatasetError
from glsim.data.recordings.opencv_yaml import read_matrices


def test_what_opencv_writes_is_read(tmp_path: Path) -> None:
    matrices = {
        "cameraMatrix": np.array([[364.9, 0, 1 / 3], [0, 1e-9, -2.5e30], [0, 0, 1]]),
        "lens": np.array([[0.11, -0.36, -0.004, 0.004, 0.16]]),
        "small": np.arange(40, dtype=np.float32).reshape(4, 10),
    }
    storage = cv2.FileStorage(str(tmp_path / "a.yaml"), cv2.FILE_STORAGE_WRITE)
    for name, matrix in matrices.items():
        storage.write(name, matrix)
    storage.release()
    found = read_matrices(tmp_path / "a.yaml")
    assert found.keys() == matrices.keys()
    for name, matrix in matrices.items():
        np.testing.assert_array_equal(found[name], matrix)


_HEAD = "%YAML:1.0\n---\ncameraMatrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"


@pytest.mark.parametrize(
    "data", ["1, 2", "1, 2, 3, 4, 5, 6, 7, 8, x", ".Nan, 2, 3, 4, 5, 6, 7, 8, 9"]
)
def test_other_numbers_are_refused(tmp_path: Path, data: str) -> None:
    (tmp_path / "a.yaml").write_text(f"{_HEAD}   data: [ {data} ]\n")
    with pytest.raises(DatasetError, match="cameraMatrix is not of 3 x 3 finite numbers"):
        read_matrices(tmp_path / "a.yaml")
