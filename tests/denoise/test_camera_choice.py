"""The network that ``glsim denoise`` takes without -d, and its warning about another one."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.core.files.png import encode_png
from glsim.denoise.camera_choice import Camera, fitting_denoiser
from tests.support.dataset_fakes import make, make_settings, make_tasks


def maps(
    folder: Path, size: tuple[int, int], *, lattice: bool = False, farthest_mm: float = 3000
) -> str:
    """Write a tilted plane of that size, on a lattice of 1/32 px of disparity or not."""
    depth = np.linspace(900, farthest_mm, size[0] * size[1]).reshape(size)
    if lattice:
        depth = np.rint(626813 / np.rint(626813 / depth))
    folder.mkdir(exist_ok=True)
    (folder / "a.png").write_bytes(encode_png(depth.astype(np.uint16)))
    return str(folder)


@pytest.mark.parametrize(
    ("given", "sensor", "name", "words"),
    [
        (None, "kinect-v2", "face-kinect-v2", "like kinect-v2, because it is stated; -d chooses"),
        (None, "", "face", "denoiser face: it is stated; -d chooses another"),
        ("face-stereo", "kinect-v2-sdk", "face-stereo", "-d face-kinect-v2 fits"),
        ("face-stereo", "truedepth", "face-stereo", ""),
        ("face-stereo", "", "face-stereo", ""),
        ("face", "kinect-v2", "face", ""),
        ("median:size=5", "kinect-v2", "median:size=5", ""),
    ],
)
def test_a_network_is_chosen_or_warned_about(
    given: str | None, sensor: str, name: str, words: str
) -> None:
    chosen, line = fitting_denoiser(given, Camera(sensor, "it is stated"))
    assert chosen == name
    assert words in line
    assert bool(words) == bool(line)


def test_denoise_says_what_it_takes_and_why(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["-o", str(tmp_path / "o")]
    kinect = maps(tmp_path / "kinect", (424, 512))
    assert main(["denoise", kinect, *out]) == 0
    assert "face-kinect-v2: like kinect-v2, because its images have 512 x 424" in (
        capsys.readouterr().err
    )
    assert main(["denoise", kinect, *out, "-d", "face-azure-kinect"]) == 0
    assert "up to 2.3 times that of a filter: -d face-kinect-v2 fits" in capsys.readouterr().err
    Path(kinect, "camera.toml").write_text('sensor = "azure-kinect"\n')
    assert main(["denoise", kinect, *out, "-d", "median"]) == 0
    assert "denoiser" not in capsys.readouterr().err
    assert main(["denoise", maps(tmp_path / "stereo", (96, 128), lattice=True), *out]) == 0
    printed = capsys.readouterr().err
    assert "face-stereo: like realsense-d435, because its depths lie on a lattice" in printed
    assert main(["denoise", maps(tmp_path / "plain", (96, 128), farthest_mm=940), *out]) == 0
    printed = capsys.readouterr().err
    assert "denoiser face: neither a file nor the maps say" in printed
    assert "1 map(s) came back unchanged" in printed, "a plane without noise"
    shutil.copy(next((tmp_path / "plain").iterdir()), tmp_path / "plain" / "again.png")
    assert main(["denoise", str(tmp_path / "plain"), *out]) == 0
    assert "one still view: -d face:average=8" in capsys.readouterr().err


def test_a_data_set_states_its_sensor(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make(tmp_path / "data", make_settings(), make_tasks(1, 1))
    file = next((tmp_path / "data").rglob("*_noisy.png"))
    assert main(["denoise", str(file), "-o", str(tmp_path / "a.png")]) == 0
    assert "face-kinect-v2: like kinect-v2, because" in capsys.readouterr().err
