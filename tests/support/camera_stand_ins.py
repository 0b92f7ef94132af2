"""Modules that stand for the libraries of cameras: a plate at 700 mm that comes nearer by 1 mm.

``write_camera_module`` writes one into a folder, for a process that finds it on PYTHONPATH. They
have the functions of the real libraries that glsim uses, with their names, arguments and units, and
refuse what those refuse.
"""

from __future__ import annotations

from pathlib import Path

#: Depth, mm, of the first frame, and the size of all.
FIRST_MM, SIZE = 700, (96, 72)

_PLATE = f"""
import itertools
import numpy as np

counter = itertools.count()
width, height = {SIZE}

def plate(step_mm):
    depth = np.zeros((height, width), np.uint16)
    depth[8:-8, 8:-8] = round(({FIRST_MM} - next(counter) % 100) / step_mm)
    return depth
"""

_REALSENSE = (
    _PLATE
    + """
from types import SimpleNamespace

stream = SimpleNamespace(depth="depth", infrared="infrared")
format = SimpleNamespace(z16="z16", y8="y8")
camera_info = SimpleNamespace(name="name")

class config:
    def __init__(self):
        self.asked = []

    def enable_stream(self, *given):
        self.asked.append(given)

class pipeline:
    def start(self, config):
        assert config.asked == [("depth", "z16", 30), ("infrared", 1, "y8", 30)], config.asked
        own = SimpleNamespace(width=width, height=height, fx=70.0, fy=70.0, ppx=47.5, ppy=35.5)
        video = SimpleNamespace(get_intrinsics=lambda: own)
        return SimpleNamespace(
            get_device=lambda: SimpleNamespace(
                get_info=lambda what: "Intel RealSense Stand-in",
                first_depth_sensor=lambda: SimpleNamespace(get_depth_scale=lambda: 0.0001),
            ),
            get_stream=lambda which: SimpleNamespace(as_video_stream_profile=lambda: video),
        )

    def wait_for_frames(self, timeout_ms):
        depth, light = plate(0.1), np.full((height, width), 90, np.uint8)
        return SimpleNamespace(
            get_depth_frame=lambda: SimpleNamespace(get_data=lambda: depth),
            get_infrared_frame=lambda index: SimpleNamespace(get_data=lambda: light),
        )

    def stop(self):
        pass
"""
)

_PYK4A = (
    _PLATE
    + """
from enum import IntEnum
from types import SimpleNamespace

width, height = 640, 576

class ColorResolution(IntEnum):
    OFF = 0

class DepthMode(IntEnum):
    NFOV_UNBINNED = 2

class FPS(IntEnum):
    FPS_30 = 2

class CalibrationType(IntEnum):
    DEPTH = 0

class Config(SimpleNamespace):
    pass

class PyK4A:
    def __init__(self, config):
        # the library's own rule: colour is off only without synchronised images
        assert config.color_resolution or not config.synchronized_images_only
        self.started = False

    def start(self):
        self.started = True

    @property
    def calibration(self):
        matrix = np.array([[500.0, 0, 320.0], [0, 500.0, 330.0], [0, 0, 1]])
        return SimpleNamespace(get_camera_matrix=lambda camera: matrix)

    def get_capture(self, timeout):
        assert self.started
        return SimpleNamespace(depth=plate(1), ir=np.full((height, width), 3000, np.uint16))

    def stop(self):
        self.started = False
"""
)

_DEPTHAI = (
    _PLATE
    + """
from types import SimpleNamespace

node = SimpleNamespace(StereoDepth="StereoDepth")

class Message:
    def getTransformation(self):
        matrix = [[75.0, 0, 48.0], [0, 75.0, 36.0], [0, 0, 1]]
        return SimpleNamespace(getIntrinsicMatrix=lambda: matrix)

    def getWidth(self):
        return width

    def getHeight(self):
        return height

    def getFrame(self):
        return plate(1)

class Stereo:
    def build(self, autoCreateCameras):
        queue = SimpleNamespace(get=lambda timeout: Message())
        self.depth = SimpleNamespace(createOutputQueue=lambda maxSize, blocking: queue)
        return self

class Pipeline:
    def create(self, kind):
        assert kind == "StereoDepth"
        return Stereo()

    def start(self):
        pass

    def stop(self):
        pass

    def getDefaultDevice(self):
        return SimpleNamespace(getProductName=lambda: "OAK-D Stand-in")
"""
)

_MODULES = {"pyrealsense2": _REALSENSE, "pyk4a": _PYK4A, "depthai": _DEPTHAI}


def write_camera_module(folder: Path, package: str, *, broken: str = "") -> None:
    """Write the stand-in of a package. broken: Python at its end, e.g. that raises."""
    (folder / f"{package}.py").write_text(_MODULES[package] + broken)
