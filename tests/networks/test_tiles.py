"""Large frames are denoised in tiles, with the result of the whole frame."""

from collections.abc import Mapping

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.denoise.registry import shipped_file
from glsim.networks.network import SIZE_MULTIPLE_PX, NetworkFunction
from glsim.networks.onnx_file import OpenCvNetwork, read_onnx
from glsim.networks.tiles import MARGIN_PX, TILE_PX, run_tiled
from tests.support.runners import Runs

Image = NDArray[np.float32]


def scene(height: int, width: int) -> Image:
    """A wavy noisy surface with steps of 200 mm and holes, mm."""
    rng = np.random.default_rng(3)
    rows, columns = np.mgrid[:height, :width].astype(np.float32)
    depth = 900 + 40 * np.sin(rows / 31) * np.cos(columns / 47)
    depth += 200 * ((rows // 90 + columns // 110) % 2) + rng.normal(0, 1.5, rows.shape)
    depth[rng.random(rows.shape) < 0.05] = 0
    return depth.astype(np.float32)


class Blur(Runs):
    """Averages as far as a margin reaches, and notes the sizes of what it gets."""

    def __init__(self, margin_px: int) -> None:
        self.side = 2 * margin_px + 1
        self.shapes: list[tuple[int, ...]] = []

    def __call__(self, stack: Image) -> Mapping[str, Image]:
        noisy_mm = stack[0]
        self.shapes.append(noisy_mm.shape)
        mean = cv2.blur(noisy_mm, (self.side, self.side), borderType=cv2.BORDER_CONSTANT)
        depth_mm = np.asarray(mean, np.float32)
        return {"depth_mm": depth_mm, "probability": (noisy_mm > 0).astype(np.float32)}


@pytest.mark.parametrize("shape", [(96, 96), (96, 112), (160, 64), (304, 208), (64, 1024)])
def test_tiles_give_what_the_whole_frame_gives(shape: tuple[int, int]) -> None:
    frame = scene(*shape)
    network = Blur(16)
    tiled = run_tiled(network, frame[None], tile_px=96, margin_px=16)
    whole = Blur(16)(frame[None])
    assert tiled.keys() == whole.keys()
    for name, image in whole.items():
        np.testing.assert_allclose(tiled[name], image, atol=1e-3)
    if shape[0] * shape[1] <= 96 * 96:
        assert network.shapes == [shape]
    else:  # of one size each: a runtime plans its memory once
        assert {*network.shapes} == {(min(96, shape[0]), min(96, shape[1]))}


@pytest.mark.long
def test_the_shipped_network_gives_the_same_to_a_hundredth_of_a_millimetre() -> None:
    path = shipped_file("face")
    network = OpenCvNetwork(*read_onnx(path))
    frame = scene(288, 304)
    whole = network(frame[None])
    tiled = run_tiled(network, frame[None], tile_px=272)
    assert tiled.keys() == whole.keys()
    known = whole["depth_mm"] > 0
    assert np.abs(tiled["depth_mm"] - whole["depth_mm"])[known].max() < 0.01
    assert np.abs(tiled["probability"] - whole["probability"]).max() < 1e-4


def test_a_denoiser_divides_large_frames_only() -> None:
    for unit in (TILE_PX, MARGIN_PX):
        assert unit % SIZE_MULTIPLE_PX == 0
    network = Blur(2)
    denoise = NetworkFunction(network, "blur")
    for shape in ((800, 1280), (1032, 1030)):
        frame = np.zeros(shape, np.float32)
        depth = denoise(frame[None], frame[None] > 0, 0)[0]
        assert depth.shape == shape
    assert network.shapes == [(800, 1280), *[(1024, 1024)] * 4]
