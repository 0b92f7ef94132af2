"""Sets of depth frames to measure: a recording on disk, a data set of glsim, or arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from glsim.compare.surfaces import Surfaces, fit_surfaces
from glsim.dataset.header import is_dataset
from glsim.dataset.reader import open_dataset
from glsim.dataset.recordings import check_sizes, find_frames
from glsim.errors import ConfigError, DatasetError
from glsim.geometry.camera import Intrinsics
from glsim.sensors.sensor import load_sensor
from glsim.settings.schema import DEFAULT_SENSOR

Array = NDArray[np.float32]

#: Infrared counts from here on are saturated (the files end at 65,535).
SATURATED = 65_000.0
#: Frames that are measured if a set has more; more do not change the printed digits.
DEFAULT_FRAMES = 60
#: Consecutive frames that are kept together, so that static pairs stay pairs.
_RUN = 4


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """One frame. depth_mm: (H, W) float32, NaN = no depth. infrared: (H, W) counts or None.

    quantum_mm: step of the stored depths, whose rounding adds quantum^2 / 12 to every variance.
    """

    name: str
    depth_mm: Array
    infrared: Array | None
    camera: Intrinsics
    quantum_mm: float = 1.0

    @cached_property
    def rays(self) -> Array:
        """(H, W, 2) x/z and y/z of the pixels; the lens's distortion is left out."""
        return self.camera.rays()

    @cached_property
    def radius_px(self) -> Array:
        """(H, W) distance of each pixel from the principal point, in pixels of a Kinect V2.

        Other cameras are scaled to its focal length of 365 px, so that radii are angles.
        """
        rays = self.rays
        return np.asarray(365.0 * np.hypot(rays[..., 0], rays[..., 1]), np.float32)

    @cached_property
    def surfaces(self) -> Surfaces:
        """Quadrics in 7 x 7 pixels: residual, slope and roughness of every complete window."""
        return fit_surfaces(self.depth_mm, self.rays, 7)

    @property
    def lit(self) -> NDArray[np.bool_]:
        """(H, W) pixels whose infrared is present and not saturated; all without infrared."""
        if self.infrared is None:
            return np.ones(self.depth_mm.shape, np.bool_)
        return (self.infrared > 0) & (self.infrared < SATURATED)


@dataclass(frozen=True, eq=False)
class FrameSet:
    """Frames of one size and one camera, in order; title names them in tables."""

    title: str
    frames: tuple[DepthFrame, ...]

    @property
    def has_infrared(self) -> bool:
        """Whether at least one frame has an infrared image."""
        return any(frame.infrared is not None for frame in self.frames)


def frame_set(
    title: str,
    depth_mm: Sequence[NDArray[np.generic]],
    infrared: Sequence[NDArray[np.generic]] | None = None,
    camera: Intrinsics | None = None,
    quantum_mm: float = 1.0,
) -> FrameSet:
    """Make a set of arrays: (H, W) depths in mm, 0 or NaN = none, and infrared counts.

    camera: default: a Kinect V2, or its focal length for another size.
    """
    depths = [_with_nan(np.asarray(d, np.float32)) for d in depth_mm]
    shape = depths[0].shape
    rig = load_sensor(DEFAULT_SENSOR).rig.for_map((shape[0], shape[1]))
    frames = tuple(
        DepthFrame(
            f"{number:05d}",
            depth,
            None if infrared is None else np.asarray(infrared[number], np.float32),
            camera or rig.intrinsics,
            quantum_mm,
        )
        for number, depth in enumerate(depths)
    )
    return FrameSet(title, frames)


def read_frame_set(
    path: Path,
    unit_mm: float = 1.0,
    focal_px: float | None = None,
    most: int = DEFAULT_FRAMES,
    mirror: bool = False,
) -> FrameSet:
    """Read a data set of glsim (its noisy layer), or a folder as ``find_frames`` describes.

    focal_px: overrides the camera's focal length. most: larger sets are thinned evenly, in runs
    of four consecutive frames. Raises ConfigError or DatasetError: no such folder, no frames,
    frames of several sizes, or no depth at all.
    """
    if not path.is_dir():
        raise ConfigError(f"{path}: no such folder")
    frames = (
        _of_dataset(path, most) if is_dataset(path) else _of_folder(path, unit_mm, most, mirror)
    )
    check_sizes([(frame.name, frame.depth_mm.shape) for frame in frames], str(path))
    for frame in frames:
        if frame.infrared is not None:
            pair = [("depth", frame.depth_mm.shape), ("infrared", frame.infrared.shape)]
            check_sizes(pair, f"{path}: {frame.name}")
    if not any(np.isfinite(frame.depth_mm).any() for frame in frames):
        raise DatasetError(f"{path}: no pixel of any frame has depth (all are 0)")
    if focal_px is not None:
        frames = [_with_focal(frame, focal_px) for frame in frames]
    return FrameSet(path.name or str(path), tuple(frames))


def _of_dataset(path: Path, most: int) -> list[DepthFrame]:
    dataset = open_dataset(path)
    if len(dataset) == 0:
        raise DatasetError(f"{path}: has no frames")
    if "noisy" not in dataset.layers:
        raise DatasetError(f"{path}: has no layer 'noisy': generate it with --layers clean,noisy")
    frames = []
    for number in _chosen(len(dataset), most):
        pair = dataset.pair(number)
        has_infrared = "infrared" in pair.record["files"]
        frames.append(
            DepthFrame(
                f"{pair.split}/{pair.subject}/{pair.sequence}_{pair.frame:05d}",
                _with_nan(pair.noisy_mm),
                pair.infrared.astype(np.float32) if has_infrared else None,
                pair.intrinsics,
                dataset.depth_unit_mm,
            )
        )
    return frames


def _of_folder(path: Path, unit_mm: float, most: int, mirror: bool) -> list[DepthFrame]:
    found = find_frames(path, unit_mm, mirror)
    rig = load_sensor(DEFAULT_SENSOR).rig
    frames = []
    for number in _chosen(len(found.frames), most):
        recorded = found.frames[number]
        depth = _with_nan(recorded.depth_mm())
        camera = found.intrinsics
        if camera is None or (camera.height, camera.width) != depth.shape:
            camera = rig.for_map((depth.shape[0], depth.shape[1])).intrinsics
        frames.append(
            DepthFrame(recorded.name, depth, recorded.infrared(), camera, recorded.quantum_mm)
        )
    return frames


def _chosen(count: int, most: int) -> list[int]:
    """Return the numbers of at most ``most`` frames, evenly spread runs of consecutive ones."""
    if count <= most:
        return list(range(count))
    runs = max(1, most // _RUN)
    starts = np.linspace(0, count - _RUN, runs).round().astype(int)
    return sorted({int(start) + step for start in starts for step in range(_RUN)})


def _with_nan(depth_mm: Array) -> Array:
    return np.where(depth_mm > 0, depth_mm, np.float32(np.nan)).astype(np.float32)


def _with_focal(frame: DepthFrame, focal_px: float) -> DepthFrame:
    own = frame.camera
    camera = Intrinsics(own.width, own.height, focal_px, focal_px, own.cx, own.cy)
    return DepthFrame(frame.name, frame.depth_mm, frame.infrared, camera, frame.quantum_mm)
