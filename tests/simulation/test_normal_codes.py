"""Normals as 16-bit codes, and as RGB images in PNG files."""

from __future__ import annotations

import numpy as np
import pytest

from glsim.core.errors import DatasetError
from glsim.core.files.png import encode_png
from glsim.data.layer_images import decode_layer
from glsim.simulation.frame import decode_normals, encode_normals


def test_normals_come_back_within_the_step_of_a_code() -> None:
    rng = np.random.default_rng(2)
    normals = rng.normal(size=(30, 40, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[0, :3] = [[-1, 0, 0], [0, 1, 0], [0, 0, -1]]
    seen = rng.random((30, 40)) < 0.7
    seen[0, :3] = True
    codes = encode_normals(normals, seen)
    assert codes.dtype == np.uint16
    assert codes[0, 0].tolist() == [1, 32768, 32768]
    assert (codes.any(axis=-1) == seen).all()
    again = decode_layer(encode_png(codes), "normals", "a file")
    np.testing.assert_array_equal(again, codes)
    decoded = decode_normals(codes)
    np.testing.assert_allclose(decoded[seen], normals[seen], atol=3e-5)
    assert not decoded[~seen].any()


def test_channels_are_those_of_the_layer() -> None:
    grey, colour = np.zeros((4, 5), np.uint16), np.zeros((4, 5, 3), np.uint16)
    with pytest.raises(DatasetError, match="has 1 channels instead of three"):
        decode_layer(encode_png(grey), "normals", "a file")
    with pytest.raises(DatasetError, match="has 3 channels instead of one"):
        decode_layer(encode_png(colour), "noisy", "a file")
