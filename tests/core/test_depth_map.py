"""Surfaces of depth maps: the same masks and normals from NumPy and PyTorch, as OpenCV has them."""

import cv2
import numpy as np
import pytest
import torch

from glsim.core.depth_map import BAND_PX, JUMP_MM, dilated, interior, jumps, normals

#: A slope with a step and holes, mm.
DEPTH = np.linspace(800, 900, 40, dtype=np.float32) + np.zeros((30, 1), np.float32)
DEPTH[:, 25:] += JUMP_MM + 5
DEPTH[np.random.default_rng(0).random(DEPTH.shape) > 0.98] = 0


@pytest.mark.parametrize("radius", [0, 1, 2, 3, 5, 45])
def test_dilation_is_that_of_opencv(radius: int) -> None:
    holes = DEPTH == 0
    square = np.ones((2 * radius + 1,) * 2, np.uint8)
    expected = cv2.dilate(holes.astype(np.uint8), square) > 0
    np.testing.assert_array_equal(dilated(holes, radius), expected)
    np.testing.assert_array_equal(dilated(torch.from_numpy(holes)[None], radius)[0], expected)


def test_the_interior_is_away_from_holes_and_jumps() -> None:
    inside = interior(DEPTH > 0, jumps(DEPTH))
    marked = jumps(DEPTH)
    assert not marked[:, :24].any()
    assert (marked[:, 24:26] == (DEPTH[:, 24:25] > 0) & (DEPTH[:, 25:26] > 0)).all()
    for row, column in zip(*np.nonzero(inside), strict=True):
        around = np.s_[max(row - BAND_PX, 0) : row + 4, max(column - BAND_PX, 0) : column + 4]
        assert (DEPTH[around] > 0).all()
        assert abs(column - 24.5) > BAND_PX
    assert inside[0].any()  # the image border is no edge
    tensor = torch.from_numpy(DEPTH)[None, None]
    np.testing.assert_array_equal(interior(tensor > 0, jumps(tensor))[0, 0], inside)


def test_normals_of_tensors_are_those_of_arrays() -> None:
    y, x = np.mgrid[-0.15:0.15:30j, -0.2:0.2:40j].astype(np.float32)
    depth_m, rays = DEPTH / np.float32(1000), np.stack([x, y], -1)
    found = normals(torch.from_numpy(depth_m)[None], torch.from_numpy(rays)[None])[0]
    expected = normals(depth_m, rays)
    assert expected.dtype == np.float32
    np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(expected, axis=-1), 1, atol=1e-6)
    assert (expected[DEPTH == 0] == (0, 0, -1)).all()
