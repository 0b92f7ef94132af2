"""Simulate sensor noise on given clean depth maps, one by one: by OpenGL or NumPy."""

from __future__ import annotations

import math
import os
import weakref
import zlib
from collections.abc import Callable
from typing import Any

import numpy as np

from glsim.core import depth_map
from glsim.core.array_types import Floats, Reals
from glsim.core.errors import ConfigError, MapSizeError
from glsim.core.mesh import SKIN_ALBEDO
from glsim.core.rect import Rect
from glsim.core.seeds import stable_seed
from glsim.faces.face_source import FaceKey
from glsim.gl.context import make_current, open_context
from glsim.gl.targets import Readback
from glsim.noise.array_chain import run_array_stages
from glsim.noise.chain import ShaderChain
from glsim.noise.frame_context import FrameContext
from glsim.noise.stage import sample_values
from glsim.render.renderer import Renderer
from glsim.sensors.images import check_shape
from glsim.sensors.sensor import sensor_of
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import OutputSettings, Settings
from glsim.simulation.assembly import assemble_frame
from glsim.simulation.frame import Frame

#: Shortest side of a map, pixels, for cameras that match two images: a smaller map is no larger
#: than the matcher's windows and steps (measured).
_LEAST_MATCHED_PX = 8
#: Names of the floating types that NumPy and PyTorch share.
_FLOATS = ("float16", "float32", "float64")


class _Graphics:
    """The GL context, renderer, noise chain and readback of one process."""

    def __init__(self, maps: MapEngine, backend: str | None) -> None:
        self.process = os.getpid()
        self.context = open_context(backend)
        self.renderer = Renderer(self.context, maps.canvas)
        sensor = maps.sensor
        self.chain = ShaderChain(self.context, sensor.stages, images=sensor.images)
        self.readback = Readback(self.context)


def _release(opened: list[_Graphics]) -> None:
    for graphics in opened:
        if graphics.process == os.getpid():
            graphics.context.release()
    opened.clear()


class MapEngine:
    """The noise chain of a sensor for depth maps of one size, one by one, by OpenGL or NumPy.

    Each process opens a GL context of its own with its first map.

    Args:
        settings: the settings; sensor, rig, seed, stage parameters and output.depth_unit_mm count.
        shape: (height, width) of the maps, pixels.
        backend: "egl", "osmesa", "numpy" (the twins, without GL) or None (a GL that works).
        focal_px, centre_px: (x, y) of the camera that made the maps. By default the sensor's for
            maps of the sensor's size; crops get its focal length, and their own centre.
    """

    def __init__(
        self,
        settings: Settings,
        shape: tuple[int, int],
        backend: str | None = None,
        focal_px: tuple[float, float] | None = None,
        centre_px: tuple[float, float] | None = None,
    ) -> None:
        self._settings, self._backend = settings, backend
        self.sensor = sensor_of(settings)
        self.rig = self.sensor.rig.for_map(shape, focal_px, centre_px)
        self.canvas = self.rig.canvas()
        if self.rig.imagers_m and min(shape) < _LEAST_MATCHED_PX:
            raise MapSizeError(
                f"a map of {shape[1]} x {shape[0]} pixels is smaller than the window of "
                f"{self.sensor.name}: give at least {_LEAST_MATCHED_PX} x {_LEAST_MATCHED_PX}"
            )
        if self.rig.imagers_m and backend == "numpy":
            raise ConfigError(
                f"{self.sensor.name}: its imagers see the map's surface from other places, which "
                "takes OpenGL: use --backend egl or osmesa"
            )
        if (own := self.sensor.pattern_map) is not None:
            check_shape(own.values, shape, str(own.file))
        self._output = OutputSettings(depth_unit_mm=settings.output.depth_unit_mm)
        #: The graphics once they are open; a finalizer releases them at the end of the engine.
        self._opened: list[_Graphics] = []
        weakref.finalize(self, _release, self._opened).atexit = False

    def close(self) -> None:
        """Release the GL context."""
        _release(self._opened)

    def frame(self, depth_m: Floats, key: FaceKey, seeds: ScopeSeeds) -> Frame:
        """Simulate the frame of a map from ``surface_depth``. Raises ConfigError."""
        sampled, values = sample_values(self.sensor.stages, seeds)
        whole = self.rig.intrinsics
        delivered = self.rig.on_canvas(Rect(0, 0, whole.width, whole.height))
        image = self.canvas.intrinsics
        window = Rect(0, 0, image.width, image.height)
        if window != delivered:
            inside, depth_m = depth_m, np.zeros((image.height, image.width), np.float32)
            depth_m[delivered.slices] = inside
        if not depth_m.any():  # an empty map has no surface to light
            layers = dict.fromkeys(("clean", "depth", "reason"), np.zeros_like(depth_m))
        elif self._backend == "numpy":
            layers = self._array_layers(depth_m)
            frame = self._context(window, seeds, depth_m, float(depth_m[depth_m > 0].min()))
            run_array_stages(self.sensor.stages, layers, frame, values, twins=True)
        else:
            if not self._opened or self._opened[0].process != os.getpid():
                self._opened[:] = [_Graphics(self, self._backend)]
            (graphics,) = self._opened
            make_current(graphics.context)
            normal = depth_map.normals(depth_m, self.canvas.rays())
            surface = depth_map.surface(depth_m, self.canvas)
            with graphics.renderer.light_depth_map(depth_m, normal, surface) as rendered:
                frame = self._context(rendered.window, seeds, depth_m, rendered.nearest_m)
                graphics.chain.run(rendered, frame, values, graphics.readback)
            layers = graphics.readback.arrays()
            run_array_stages(self.sensor.stages, layers, frame, values)
        return assemble_frame(
            layers,
            window,
            delivered,
            image,
            self._output,
            key=key,
            source="depth map",
            seed=seeds.frame,
            parameters=sampled,
        )

    def _context(
        self, window: Rect, seeds: ScopeSeeds, depth_m: Floats, nearest_m: float
    ) -> FrameContext:
        # Cameras expose to a mean brightness, and light decreases with the square of the distance.
        brightness = np.mean(depth_m[depth_m > 0].astype(np.float64) ** -2)
        return FrameContext.for_frame(
            rig=self.canvas,
            window=window,
            seed=seeds.frame,
            sequence_seed=seeds.sequence,
            device_seed=stable_seed("device", self._settings.seed, 0),
            nearest_m=nearest_m,
            subject_m=float(brightness**-0.5),
            supersample=1,  # a map has one sample per pixel
        )

    def _array_layers(self, depth_m: Floats) -> dict[str, Floats]:
        """Compute the input layers of a noise chain in NumPy, without OpenGL."""
        rays = self.rig.rays()
        albedo = np.where(depth_m > 0, np.float32(SKIN_ALBEDO), np.float32(0))
        return {
            **self.sensor.images,
            "clean": depth_m,
            "depth": depth_m,
            "reason": np.zeros_like(depth_m),
            "normal": np.dstack([depth_map.normals(depth_m, rays), albedo]),
            "albedo": albedo,
            "lit": depth_map.lit_by_marching(depth_m, self.rig),
            "rays": rays,
        }


def noise_name(depth_mm: Floats) -> str:
    """Return the name of a map's noise: equal depths in any format and file have the same name."""
    # Rounding to 1/64 mm gives metres and steps the same numbers: a multiple of a step that is 0.05
    # mm or more, or a power of 2, does not lie halfway between two of them.
    steps = np.rint(depth_mm * np.float32(64)).astype("<i4")
    return f"{stable_seed(depth_mm.shape, zlib.crc32(steps.tobytes())):x}"


def surface_depth(depth: Reals, far_m: float) -> Floats:
    """Return depth as float32 metres with 0 for NaN, for values up to 0, and beyond ``far_m``."""
    # Simulators use any of these for the empty background. Unchanged maps are not copied.
    seen = (depth > 0) & (depth <= far_m)  # NaN compares as False
    if seen.all() and depth.dtype == np.float32:
        return np.ascontiguousarray(depth, np.float32)
    return np.where(seen, depth, 0).astype(np.float32)


def depth_batch(depth: Any, shape: tuple[int, int]) -> tuple[Reals, Reals, Callable[[], Any]]:
    """View an array or tensor of float depth as a batch of maps of ``shape`` (height, width).

    PyTorch is not imported: a tensor is recognised by the module of its type.

    Returns:
        The maps, (B, H, W): a view, or a copy of a tensor on a GPU or of rows that are not
        contiguous. The result, (B, H, W), not yet filled. And a function that returns the result in
        the form of the input: type, shape, number type and device.
    """
    full, stack = tuple(int(side) for side in depth.shape), (-1, *shape)
    if type(depth).__module__.partition(".")[0] != "torch":
        array = np.asarray(depth)
        answer = np.empty(full, array.dtype)
        return array.reshape(stack), answer.reshape(stack), lambda: answer
    host = depth.detach().cpu()
    made = host.new_empty(full)
    return (host.numpy().reshape(stack), made.numpy().reshape(stack), lambda: made.to(depth.device))


def map_shape(depth: Any, size: tuple[int, int] | None = None) -> tuple[tuple[int, int], int]:
    """Return (height, width) and the number of maps of an array or tensor of float depth.

    Its shape is (H, W) or (B, H, W) or has more leading axes; a last axis of length 1 is allowed.
    Raises ConfigError for another (height, width) than ``size``, and for other types and shapes.
    """
    full = tuple(int(side) for side in getattr(depth, "shape", ()))
    kind = str(getattr(depth, "dtype", type(depth).__name__)).removeprefix("torch.")
    if kind not in _FLOATS or len(full) < 2:
        raise ConfigError(
            "depth must be an array or a tensor of float metres (..., H, W) "
            f"({', '.join(_FLOATS)}), not {kind} {full}: of whole millimetres give "
            "depth.astype('float32') / 1000"
        )
    if math.prod(full) == 0:
        raise ConfigError(f"depth has the shape {full}: there is no map in it")
    deep = full[-1] == 1 and len(full) > 2 and size in (None, full[-3:-1])
    *batch, height, width = full[:-1] if deep else full
    if size not in (None, (height, width)):
        height, width = size or full
        raise ConfigError(
            f"depth has the shape {full}: the camera has {width}x{height} pixels, so it must "
            f"be {size}, (batch, {height}, {width}), or one of them with a last axis of 1"
        )
    return (height, width), math.prod(batch)
