"""Checks of the 68 landmarks in Multi-PIE's order: mirror images and places on a face."""

import numpy as np
from numpy.typing import NDArray

#: Each point's mirror image.
MIRROR = np.concatenate(
    [
        *(range(16, -1, -1), range(26, 16, -1), range(27, 31), range(35, 30, -1)),
        *((45, 44, 43, 42, 47, 46), (39, 38, 37, 36, 41, 40)),
        *(range(54, 47, -1), range(59, 54, -1), range(64, 59, -1), (67, 66, 65)),
    ]
)
MIDLINE = [8, 27, 28, 29, 30, 33, 51, 57, 62, 66]


def assert_order(points: NDArray[np.float64]) -> None:
    """Assert that (68, 3) landmarks, mm, have Multi-PIE's order and places on a face.

    x is to the subject's left, y up, z to the front; the mouth is closed.
    """
    x, y, z = points.T
    for part in (range(4, 13), range(17, 22), range(22, 27), range(31, 36), range(48, 55)):
        assert (np.diff(x[list(part)]) > 0).all(), part
    assert (np.diff(y[:9]) < 0).all()  # from the ear down to the chin, and up to the other ear
    assert (np.diff(y[8:17]) > 0).all()
    assert x[:8].max() < 0 < x[9:17].min()
    assert (np.diff(x[54:60]) < 0).all()  # back along the lower lip
    assert (np.diff(x[[60, 61, 62, 63, 64]]) > 0).all()
    assert (np.diff(x[[64, 65, 66, 67, 60]]) < 0).all()
    assert (np.diff(y[27:31]) < 0).all()  # down the bridge of the nose
    assert z[30] == z.max()  # its tip is the foremost point
    assert y[8] == y.min()  # the chin is the lowest
    for eye in (np.arange(36, 42), np.arange(42, 48)):
        assert x[eye[0]] == x[eye].min()
        assert x[eye[3]] == x[eye].max()
        assert (y[eye[[1, 2]]] > y[eye[[0, 3]]].max() - 1.5).all()
        assert y[eye[[1, 2]]].min() > y[eye[[4, 5]]].max()
        assert x[eye[1]] < x[eye[2]]
        assert x[eye[5]] < x[eye[4]]
    assert y[17:27].min() > y[36:48].max()
    assert y[48:68].max() < y[31:36].min()
    assert (y[49:54] > y[55:60][::-1]).all()
    assert y[48:68].min() > y[8]
