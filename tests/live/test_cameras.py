"""Cameras by stand-ins of their libraries: units, intrinsics, what fails and how it is said."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.errors import ConfigError, DeviceError
from glsim.live.cameras import CAMERAS, open_camera
from tests.support.camera_stand_ins import FIRST_MM, SIZE, write_camera_module

NAMES = sorted(CAMERAS)


@pytest.fixture
def modules(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder whose modules are found first, and forgotten afterwards."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    importlib.invalidate_caches()
    packages = [kind.package for kind in CAMERAS.values()]
    for package in packages:
        sys.modules.pop(package, None)
    yield tmp_path
    for package in packages:
        sys.modules.pop(package, None)


@pytest.mark.parametrize("name", NAMES)
def test_frames_are_millimetres_with_the_cameras_intrinsics(modules: Path, name: str) -> None:
    write_camera_module(modules, CAMERAS[name].package)
    camera = open_camera(name)
    try:
        first, second = camera.next(), camera.next()
    finally:
        camera.close()
    width, height = (640, 576) if name == "azure-kinect" else SIZE
    assert first.depth_mm.shape == (height, width) == (first.camera.height, first.camera.width)
    assert first.depth_mm.dtype == np.float32
    assert (first.number, second.number) == (0, 1)
    middle = first.depth_mm[height // 2, width // 2], second.depth_mm[height // 2, width // 2]
    assert middle == pytest.approx((FIRST_MM, FIRST_MM - 1), abs=1e-3)
    assert first.depth_mm[0, 0] == 0
    assert (first.infrared is None) == (name == "oak")
    # The libraries count from the centre of the first pixel, glsim from its corner.
    assert (first.camera.cx - 0.5) in (47.5, 320.0, 48.0)
    assert camera.title in ("Intel RealSense Stand-in", "Azure Kinect", "OAK-D Stand-in")


@pytest.mark.parametrize("name", NAMES)
def test_a_missing_library_is_named(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("glsim.live.cameras.find_spec", lambda package: None)
    assert main(["live", "--camera", name, "-d", "median"]) == 2
    package = CAMERAS[name].package
    assert capsys.readouterr().err == (
        f"glsim: error: --camera {name}: needs {package}, which is not installed: pip install "
        f"{package}\n"
    )


def test_a_library_that_does_not_load_is_no_traceback(modules: Path) -> None:
    """As pyk4a without Microsoft's libk4a."""
    write_camera_module(modules, "pyk4a", broken='raise ImportError("no libk4a.so\\nfound")')
    with pytest.raises(ConfigError, match=r"azure-kinect: pyk4a does not load: no libk4a.so found"):
        open_camera("azure-kinect")


def test_no_camera_is_connected(modules: Path) -> None:
    lost = "\ndef start(self, config):\n    raise RuntimeError('No device connected')\n"
    write_camera_module(modules, "pyrealsense2", broken=f"{lost}pipeline.start = start\n")
    with pytest.raises(DeviceError, match=r"realsense: cannot be opened \(No device connected\)"):
        open_camera("realsense")


def test_a_camera_that_is_unplugged_says_so_and_goes_on(modules: Path) -> None:
    lost = """
read = pipeline.wait_for_frames
calls = []
def wait_for_frames(self, timeout_ms):
    calls.append(timeout_ms)
    if len(calls) == 2:
        raise RuntimeError("Frame didn't arrive within 5000")
    return read(self, timeout_ms)
pipeline.wait_for_frames = wait_for_frames
"""
    write_camera_module(modules, "pyrealsense2", broken=lost)
    camera = open_camera("realsense")
    camera.next()
    with pytest.raises(DeviceError, match=r"gave no frame \(Frame didn't arrive within 5000\)"):
        camera.next()
    assert camera.next().number == 1


def test_an_oak_that_is_silent_is_no_empty_frame(modules: Path) -> None:
    lost = """
class Silent(Stereo):
    def build(self, autoCreateCameras):
        queue = SimpleNamespace(get=lambda timeout: None)
        self.depth = SimpleNamespace(createOutputQueue=lambda maxSize, blocking: queue)
        return self
Stereo = Silent
"""
    write_camera_module(modules, "depthai", broken=lost)
    with pytest.raises(DeviceError, match="none within 5 s"):
        open_camera("oak")


def test_an_unknown_camera() -> None:
    with pytest.raises(ConfigError, match="did you mean 'realsense'"):
        open_camera("realsence")
