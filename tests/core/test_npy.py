"""Arrays of .npy files: those that numpy writes are read, others refused."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.files.npy import map_npy


@pytest.mark.parametrize(
    "values",
    [
        np.arange(24, dtype=np.uint16).reshape(2, 3, 4),
        np.asfortranarray(np.arange(12, dtype=">f8").reshape(3, 4)),
        np.ones((5,), bool),
    ],
)
def test_what_numpy_writes_is_read(tmp_path: Path, values: NDArray[np.generic]) -> None:
    np.save(tmp_path / "a.npy", values)
    found = map_npy(tmp_path / "a.npy")
    assert found.dtype == values.dtype
    np.testing.assert_array_equal(found, values)


def test_other_values_are_refused(tmp_path: Path) -> None:
    for values in (np.array(["a"]), np.zeros(3, complex), np.zeros(2, [("a", "<u2")])):
        np.save(tmp_path / "a.npy", values)
        with pytest.raises(OSError, match="no plain real numbers"):
            map_npy(tmp_path / "a.npy")
    np.save(tmp_path / "a.npy", np.array([{}]), allow_pickle=True)
    with pytest.raises(OSError, match=r"is no whole \.npy file"):
        map_npy(tmp_path / "a.npy")
