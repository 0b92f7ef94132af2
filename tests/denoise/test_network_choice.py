"""The network that ``glsim denoise`` takes without -d."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.core.files.png import encode_png
from glsim.data.maps import open_maps
from glsim.denoise.network_choice import choose_network


def maps(
    folder: Path, size: tuple[int, int], width_px: float, *, lattice: bool = True, px: float = 0.2
) -> str:
    """Write a tilted plane with a noise of ``px`` of disparity that is alike over ``width_px``."""
    disparity = 626_813 / np.linspace(900, 1500, size[0] * size[1]).reshape(size)
    noise = np.random.default_rng(1).standard_normal(size)
    if width_px:
        noise = np.asarray(cv2.GaussianBlur(noise, (0, 0), width_px), np.float64)
    disparity += px * 32 * noise / noise.std()
    depth_mm = 626_813 / (np.rint(disparity) if lattice else disparity)  # steps of 1/32 px
    folder.mkdir(exist_ok=True)
    (folder / "a.png").write_bytes(encode_png(np.rint(depth_mm).astype(np.uint16)))
    return str(folder)


@pytest.mark.parametrize(
    ("width_px", "toml", "network", "words"),
    [
        (5.0, "", "face-stereo", "because its depths lie on a lattice"),
        (0.8, 'sensor = "kinect-v2"', "face", "of that over 2 px"),
        (0.5, 'sensor = "azure-kinect"', "face-azure-kinect", "of that over 2 px"),
        (0.0, 'sensor = "kinect-v2"', "face", "of that over 2 px"),
        (5.0, 'name = "RealSense D455, serial 7"', "face-stereo", "like realsense-d455"),
        (2.0, 'name = "iPhone 13, TrueDepth"', "face-stereo", "like truedepth"),
        (5.0, "baseline_m = 0.05", "face-stereo", "states a baseline"),
    ],
)
def test_a_network_follows_from_the_noise(
    tmp_path: Path, width_px: float, toml: str, network: str, words: str
) -> None:
    px = 0.2 if network == "face-stereo" or not toml else 0.008 if width_px == 0.5 else 0.05
    folder = Path(maps(tmp_path / "maps", (240, 320), width_px, lattice=not toml, px=px))
    if toml:
        (folder / "camera.toml").write_text(toml)
    chosen, because = choose_network(open_maps(folder, needs_camera=False))
    assert (chosen, words in because) == (network, True), because


def test_denoise_says_what_it_takes_and_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["-o", str(tmp_path / "o")]
    wide = maps(tmp_path / "wide", (96, 128), 5.0)
    assert main(["denoise", wide, *out]) == 0
    found = "because its depths lie on a lattice of disparities of f B = 19,588 px mm; -d"
    assert f"denoiser face-stereo: like realsense-d435, {found}" in capsys.readouterr().err
    assert main(["denoise", wide, *out, "-d", "median"]) == 0
    assert "denoiser" not in capsys.readouterr().err
    plane = np.linspace(900, 940, 96 * 128).reshape(96, 128)
    (tmp_path / "plain").mkdir()
    (tmp_path / "plain" / "a.png").write_bytes(encode_png(plane.astype(np.uint16)))
    assert main(["denoise", str(tmp_path / "plain"), *out]) == 0
    printed = capsys.readouterr().err
    assert "denoiser face: the maps show no noise" in printed
    assert "1 map came back unchanged" in printed, "a plane without noise"
    shutil.copy(tmp_path / "plain" / "a.png", tmp_path / "plain" / "again.png")
    assert main(["denoise", str(tmp_path / "plain"), *out]) == 0
    assert "one still view: -d face:average=8" in capsys.readouterr().err
    np.save(tmp_path / "a.npy", np.zeros((96, 128), np.float32))
    assert main(["denoise", str(tmp_path / "a.npy"), *out]) == 0
    assert "denoiser face: the maps have no depth; " in capsys.readouterr().err
