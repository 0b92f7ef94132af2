"""Depth cameras by the libraries of their makers, which glsim does not install.

The names of their functions are those of pyrealsense2 2.59, pyk4a 1.5 and depthai 3.12. The sensors
sample at 30 Hz; what is not read in time is dropped, so that the next frame is always a new one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from datetime import timedelta
from importlib import import_module
from importlib.util import find_spec
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError, DeviceError, did_you_mean
from glsim.geometry.camera import Intrinsics
from glsim.live.source import LiveFrame

#: How long a camera may take to deliver a frame, ms: the exposure settles within a second.
_PATIENCE_MS: Final = 5000

Image = NDArray[Any]


class Camera(ABC):
    """A camera that gives frame after frame; a ``Source``.

    A library's errors of any kind become DeviceError.

    Attributes:
        title: the name of the model, as the camera says it.
        camera: its intrinsics.
        package: that has to be installed.
    """

    package: ClassVar[str]
    frames: int | None = None
    title: str
    camera: Intrinsics

    def __init__(self, library: Any) -> None:
        """Open the first camera of this kind that is connected. Raises DeviceError."""
        self._count = 0
        try:
            self._open(library)
        except Exception as error:
            self.close()
            raise self._failure("cannot be opened", error) from None

    def next(self) -> LiveFrame:
        """Wait for the next frame and return it. Raises DeviceError without one in 5 s."""
        try:
            depth_mm, counts = self._read()
        except Exception as error:
            raise self._failure("gave no frame", error) from None
        infrared = None if counts is None else counts.astype(np.float32)
        self._count += 1
        return LiveFrame(self._count - 1, depth_mm.astype(np.float32), infrared, self.camera)

    def close(self) -> None:
        """Let the camera go; one that was unplugged is gone already."""
        with suppress(Exception):
            self._close()

    def _failure(self, what: str, error: Exception) -> DeviceError:
        said = " ".join(str(error).split()) or repr(error)
        return DeviceError(
            f"--camera {name_of(type(self))}: {what} ({said}): is it connected to a port of USB 3, "
            "and does no other program use it?"
        )

    @abstractmethod
    def _open(self, library: Any) -> None: ...

    @abstractmethod
    def _read(self) -> tuple[Image, Image | None]:
        """Return (H, W) depth, mm, and infrared counts; new arrays."""

    @abstractmethod
    def _close(self) -> None: ...


class RealSense(Camera):
    """Cameras of Intel RealSense: depth and the left infrared image, both rectified."""

    package = "pyrealsense2"

    def _open(self, library: Any) -> None:
        rs = library
        self._pipeline = rs.pipeline()
        config = rs.config()
        config.enable_stream(rs.stream.depth, rs.format.z16, 30)
        config.enable_stream(rs.stream.infrared, 1, rs.format.y8, 30)
        profile = self._pipeline.start(config)
        device = profile.get_device()
        self.title = device.get_info(rs.camera_info.name)
        self._unit_mm = 1000.0 * device.first_depth_sensor().get_depth_scale()
        own = profile.get_stream(rs.stream.depth).as_video_stream_profile().get_intrinsics()
        self.camera = _from_pixel_centres(own.width, own.height, own.fx, own.fy, own.ppx, own.ppy)

    def _read(self) -> tuple[Image, Image | None]:
        frames = self._pipeline.wait_for_frames(_PATIENCE_MS)
        depth = np.asarray(frames.get_depth_frame().get_data())
        light = frames.get_infrared_frame(1)
        counts = np.array(light.get_data()) if light else None
        return depth * np.float32(self._unit_mm), counts

    def _close(self) -> None:
        self._pipeline.stop()


class AzureKinect(Camera):
    """Azure Kinect and Femto Bolt, in the mode NFOV_UNBINNED of 640 x 576 pixels."""

    package = "pyk4a"

    def _open(self, library: Any) -> None:
        k4a = library
        config = k4a.Config(
            color_resolution=k4a.ColorResolution.OFF,
            depth_mode=k4a.DepthMode.NFOV_UNBINNED,
            camera_fps=k4a.FPS.FPS_30,
            synchronized_images_only=False,
        )
        self._device = k4a.PyK4A(config)
        self._device.start()
        self.title = "Azure Kinect"
        matrix = self._device.calibration.get_camera_matrix(k4a.CalibrationType.DEPTH)
        self.camera = _from_matrix(640, 576, matrix)

    def _read(self) -> tuple[Image, Image | None]:
        capture = self._device.get_capture(_PATIENCE_MS)
        if capture.depth is None:
            raise ValueError("a capture without depth")
        return np.array(capture.depth), None if capture.ir is None else np.array(capture.ir)

    def _close(self) -> None:
        self._device.stop()


class Oak(Camera):
    """Stereo cameras of Luxonis (OAK-D): depth of the rectified view, matched on the camera."""

    package = "depthai"

    def _open(self, library: Any) -> None:
        dai = library
        self._pipeline = dai.Pipeline()
        stereo = self._pipeline.create(dai.node.StereoDepth).build(autoCreateCameras=True)
        self._queue = stereo.depth.createOutputQueue(maxSize=1, blocking=False)
        self._pipeline.start()
        self.title = self._pipeline.getDefaultDevice().getProductName()
        first = self._message()
        matrix = first.getTransformation().getIntrinsicMatrix()
        self.camera = _from_matrix(first.getWidth(), first.getHeight(), matrix)

    def _read(self) -> tuple[Image, Image | None]:
        return np.array(self._message().getFrame()), None  # uint16 millimetres

    def _message(self) -> Any:
        message = self._queue.get(timedelta(milliseconds=_PATIENCE_MS))
        if message is None:
            raise TimeoutError(f"none within {_PATIENCE_MS / 1000:g} s")
        return message

    def _close(self) -> None:
        self._pipeline.stop()


#: Name on the command line -> camera.
CAMERAS: Final[dict[str, type[Camera]]] = {
    "realsense": RealSense,
    "azure-kinect": AzureKinect,
    "oak": Oak,
}


def name_of(kind: type[Camera]) -> str:
    """Return a camera's name on the command line."""
    return next(name for name, own in CAMERAS.items() if own is kind)


def open_camera(name: str) -> Camera:
    """Open the first connected camera of a kind.

    Raises:
        ConfigError: for an unknown name, or if its library is not installed or does not load.
        DeviceError: no such camera is connected, or another program uses it.
    """
    if name not in CAMERAS:
        raise ConfigError(f"--camera {name}: {did_you_mean(name, CAMERAS)}")
    kind = CAMERAS[name]
    if find_spec(kind.package) is None:
        raise ConfigError(
            f"--camera {name}: needs {kind.package}, which is not installed: pip install "
            f"{kind.package}"
        )
    try:
        library = import_module(kind.package)
    except Exception as error:  # of the maker's own shared library
        said = " ".join(str(error).split()) or repr(error)
        raise ConfigError(f"--camera {name}: {kind.package} does not load: {said}") from None
    return kind(library)


def _from_pixel_centres(
    width: int, height: int, fx: float, fy: float, cx: float, cy: float
) -> Intrinsics:
    """Return intrinsics of a library that counts from the first pixel's centre; all here do."""
    return Intrinsics(width, height, fx, fy, cx + 0.5, cy + 0.5)


def _from_matrix(width: int, height: int, matrix: Sequence[Sequence[float]]) -> Intrinsics:
    (fx, _, cx), (_, fy, cy), _ = ([float(value) for value in row] for row in matrix)
    return _from_pixel_centres(width, height, fx, fy, cx, cy)
