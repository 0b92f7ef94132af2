"""Depth frames in memory, and sets of them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from glsim.geometry.camera import Intrinsics
from glsim.measures.stacks import moments, with_nan
from glsim.measures.surfaces import Surfaces, fit_surfaces
from glsim.sensors.sensor import load_sensor
from glsim.settings.schema import DEFAULT_SENSOR

Array = NDArray[np.float32]
Stack = NDArray[np.float64]

#: Infrared counts from here on are saturated (the files end at 65,535).
SATURATED = 65_000.0
#: Focal length of a Kinect V2, px, to which radii are scaled.
_FOCAL_PX = 365.0


@dataclass(frozen=True, eq=False)
class DepthFrame:
    """One depth map with its camera.

    Attributes:
        name: unique in its set.
        depth_mm: (H, W) float32, NaN where there is no depth.
        infrared: (H, W) float32 counts, or None.
        camera: intrinsics; lens distortion is not modelled.
        quantum_mm: step of stored depths, whose rounding adds quantum^2 / 12 to each variance.
        clean_mm: (H, W) float32 true depth, NaN where there is no surface; None if unknown.
        layers: further (H, W, components) float32 layers of the stages of a simulated frame.

    """

    name: str
    depth_mm: Array
    infrared: Array | None
    camera: Intrinsics
    quantum_mm: float = 1.0
    clean_mm: Array | None = None
    layers: Mapping[str, Array] = field(default_factory=dict)

    @property
    def rays(self) -> Array:
        """(H, W, 2) x/z and y/z of the pixels."""
        return _rays(self.camera)

    @property
    def radius_px(self) -> Array:
        """(H, W) distance from the principal point, px of a Kinect V2, so that radii are angles."""
        return _radius_px(self.camera)

    @property
    def surfaces(self) -> Surfaces:
        """Quadrics in 7 x 7 pixels around every pixel."""
        return _surfaces(self)

    @property
    def surface_mm(self) -> Array:
        """(H, W) depth of the fitted quadric at its centre pixel.

        Bins by it do not select noise of one sign at their bounds, as bins by noisy depth do.
        """
        return np.asarray(self.depth_mm - self.surfaces.residual_mm)

    @property
    def lit(self) -> NDArray[np.bool_]:
        """(H, W) pixels whose infrared is present and not saturated; all without infrared."""
        if self.infrared is None:
            return np.ones(self.depth_mm.shape, np.bool_)
        return (self.infrared > 0) & (self.infrared < SATURATED)


@lru_cache(maxsize=2)
def _rays(camera: Intrinsics) -> Array:
    return camera.rays()


@lru_cache(maxsize=2)
def _radius_px(camera: Intrinsics) -> Array:
    rays = camera.rays()
    return np.asarray(_FOCAL_PX * np.hypot(rays[..., 0], rays[..., 1]), np.float32)


#: Each takes 3.5 MB for a Kinect V2; all of a set of 200 frames would take most of a gigabyte.
@lru_cache(maxsize=64)
def _surfaces(frame: DepthFrame) -> Surfaces:
    return fit_surfaces(frame.depth_mm, frame.rays, 7)


@dataclass(frozen=True, eq=False)
class FrameSet:
    """Frames of one size and one camera, in order; ``title`` names them in tables."""

    title: str
    frames: tuple[DepthFrame, ...]

    @property
    def camera(self) -> Intrinsics:
        """The camera of the first frame."""
        return self.frames[0].camera

    @cached_property
    def depth_mm(self) -> Stack:
        """(T, H, W) depth, mm, NaN where there is none."""
        return np.stack([frame.depth_mm for frame in self.frames]).astype(np.float64)

    @property
    def whole_mm(self) -> Stack:
        """(T, H, W) depth rounded to whole mm, NaN where there is none."""
        return np.rint(self.depth_mm)

    @property
    def encoded(self) -> NDArray[np.uint16]:
        """(T, H, W) whole mm as files of 16 bits hold them, 0 = no depth."""
        return np.nan_to_num(self.whole_mm).astype(np.uint16)

    @cached_property
    def clean_mm(self) -> Stack:
        """(H, W) true depth of the first frame, mm; all NaN if unknown."""
        clean = self.frames[0].clean_mm
        shape = self.frames[0].depth_mm.shape
        return np.full(shape, np.nan) if clean is None else clean.astype(np.float64)

    @property
    def residual_mm(self) -> Stack:
        """(T, H, W) whole mm minus the true depth of a static scene."""
        return self.whole_mm - self.clean_mm

    @cached_property
    def infrared(self) -> Array:
        """(T, H, W) counts; 0 without infrared."""
        images = [f.infrared if f.infrared is not None else 0 * f.depth_mm for f in self.frames]
        return np.stack(images).astype(np.float32)

    def layer(self, name: str) -> Array:
        """Return the (T, H, W, components) stack of a layer of simulated frames."""
        return np.stack([frame.layers[name] for frame in self.frames])

    def centre(self, width: int = 64, height: int | None = None) -> FrameSet:
        """Crop all images to their centre, width x height px (default: a square)."""
        height = width if height is None else height
        left, top = (self.camera.width - width) // 2, (self.camera.height - height) // 2
        part = np.s_[top : top + height, left : left + width]
        own = self.camera
        camera = replace(own, width=width, height=height, cx=own.cx - left, cy=own.cy - top)

        def crop(image: Array | None) -> Array | None:
            return None if image is None else image[part]

        frames = (
            DepthFrame(
                f.name,
                f.depth_mm[part],
                crop(f.infrared),
                camera,
                f.quantum_mm,
                crop(f.clean_mm),
                {name: layer[part] for name, layer in f.layers.items()},
            )
            for f in self.frames
        )
        return FrameSet(self.title, tuple(frames))

    def with_camera(self, camera: Intrinsics) -> FrameSet:
        """Return the set with other intrinsics."""
        return FrameSet(self.title, tuple(replace(f, camera=camera) for f in self.frames))

    def mean(self, part: slice = slice(None)) -> DepthFrame:
        """Return the mean of frames of one view over time; NaN where no frame has depth."""
        frames = self.frames[part]
        lights = [frame.infrared for frame in frames if frame.infrared is not None]
        light: Array | None = None
        if lights:
            light = np.asarray(np.mean(lights, axis=0, dtype=np.float64), np.float32)
        count, mean, _ = moments([frame.depth_mm for frame in frames])
        depth = np.where(count > 0, mean, np.nan).astype(np.float32)
        quantum_mm = frames[0].quantum_mm / len(frames) ** 0.5
        return DepthFrame("mean", depth, light, self.camera, quantum_mm)


def frame_set(
    title: str,
    depth_mm: Iterable[NDArray[np.generic]],
    infrared: Iterable[NDArray[np.generic]] | None = None,
    camera: Intrinsics | None = None,
    quantum_mm: float = 1.0,
) -> FrameSet:
    """Make a set of arrays.

    Args:
        title: name of the set.
        depth_mm: (H, W) depths, mm; 0 marks pixels without depth.
        infrared: (H, W) counts of each frame.
        camera: default: a Kinect V2, its principal point in the image centre if the size is not
            its own.
        quantum_mm: step of the depths.

    """
    depths = [with_nan(d).astype(np.float32) for d in depth_mm]
    height, width = depths[0].shape
    own = camera or load_sensor(DEFAULT_SENSOR).rig.for_map((height, width)).intrinsics
    lights: list[Array | None] = [None] * len(depths)
    if infrared is not None:
        lights = [np.asarray(image, np.float32) for image in infrared]
    return FrameSet(
        title,
        tuple(
            DepthFrame(f"{number:05d}", depth, light, own, quantum_mm)
            for number, (depth, light) in enumerate(zip(depths, lights, strict=True))
        ),
    )
