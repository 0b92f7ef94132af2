"""Simulation of sensor noise on given clean depth maps."""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.core import depth_map
from glsim.core.errors import ConfigError
from glsim.core.mesh import SKIN_ALBEDO
from glsim.core.rect import Rect
from glsim.core.seeds import stable_seed
from glsim.faces.face_source import FaceKey
from glsim.gl.context import make_current, open_context
from glsim.gl.targets import Readback
from glsim.noise.array_chain import run_array_stages, run_twins
from glsim.noise.chain import ShaderChain
from glsim.noise.frame_context import FrameContext
from glsim.noise.stage import draw_values
from glsim.render.renderer import Renderer
from glsim.sensors.images import check_shape
from glsim.sensors.sensor import sensor_of
from glsim.settings.distribution import DrawKeys
from glsim.settings.schema import OutputSettings, Settings, load_settings
from glsim.simulation.assembly import assemble_frame
from glsim.simulation.frame import Frame, decode_depth, refuse_millimetres

#: An array of NumPy or a tensor of PyTorch.
_Depths = TypeVar("_Depths")
#: The floating types that both NumPy and PyTorch have, by name.
_FLOATS = ("float16", "float32", "float64")


class _Graphics:
    """The GL context, renderer, noise chain and readback of one process."""

    def __init__(self, corrupter: Corrupter, backend: str | None) -> None:
        self.process = os.getpid()
        self.context = open_context(backend)
        self.renderer = Renderer(self.context, corrupter.canvas)
        sensor = corrupter.sensor
        self.chain = ShaderChain(self.context, sensor.stages, images=sensor.images)
        self.readback = Readback(self.context)


class Corrupter:
    """The noise chain of a sensor for depth maps of one size, used as a context manager.

    It may be sent to other processes, such as the workers of a DataLoader, forked or spawned: each
    opens a GL context of its own with its first map.

    settings: sensor, rig, seed, stage parameters and output.depth_unit_mm are used.
    shape: (height, width) of the maps, pixels.
    backend: "egl", "osmesa", "numpy" (the twins, without GL) or None (a GL backend that works).
    focal_px, centre_px: (x, y) of the camera that made the maps; by default the sensor's own for
        maps of the sensor's size, else (crops) its focal length and the map's centre.
    """

    def __init__(
        self,
        settings: Settings,
        shape: tuple[int, int],
        backend: str | None = None,
        focal_px: tuple[float, float] | None = None,
        centre_px: tuple[float, float] | None = None,
    ) -> None:
        self._made_of = settings, shape, backend, focal_px, centre_px
        self._settings, self._backend = settings, backend
        self.sensor = sensor_of(settings)
        self.rig = self.sensor.rig.for_map(shape, focal_px, centre_px)
        self.canvas = self.rig.canvas()
        if self.rig.imagers_m and backend == "numpy":
            raise ConfigError(
                f"{self.sensor.name}: its imagers see the map's surface from other places, which "
                "takes OpenGL: use --backend egl or osmesa"
            )
        if (own := self.sensor.pattern_map) is not None:
            check_shape(own.values, shape, str(own.file))
        self._output = OutputSettings(depth_unit_mm=settings.output.depth_unit_mm)
        self._opened: _Graphics | None = None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the constructor's arguments only: the receiving process builds a new Corrupter."""
        return type(self), self._made_of

    @classmethod
    def for_camera(
        cls,
        sensor: str | Settings,
        *,
        width: int,
        height: int,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        first_pixel: float,
        backend: str | None = None,
    ) -> Corrupter:
        """Make a Corrupter for the images of another simulator's camera.

        sensor: the name of a shipped sensor, a .toml file, or whole settings. It gives the noise,
            the emitters and the clip planes; the camera replaces its intrinsics.
        width, height, fx, fy, cx, cy: of the simulator's pinhole camera, pixels.
        first_pixel: where its cx and cy have the centre of the first pixel: 0.5 if the image
            reaches from 0 to its width (cx = width / 2 is the middle), 0 as in OpenCV and ROS.
        Raises ConfigError.
        """
        if first_pixel not in (0, 0.5):
            raise ConfigError(f"first_pixel {first_pixel}: is 0 (OpenCV, ROS) or 0.5")
        if not (fx > 0 and fy > 0 and width > 0 and height > 0):
            raise ConfigError(
                f"a camera of {width}x{height} pixels with focal lengths {fx}, {fy}: all must be "
                "positive (Gazebo, BlenderProc and Isaac may give a negative fy: take its size)"
            )
        settings = (
            load_settings(overrides={"sensor": sensor}) if isinstance(sensor, str) else sensor
        )
        shift = 0.5 - first_pixel
        return cls(settings, (height, width), backend, (fx, fy), (cx + shift, cy + shift))

    def __enter__(self) -> Corrupter:
        return self

    def __exit__(self, *_: object) -> None:
        if self._opened is not None and self._opened.process == os.getpid():
            self._opened.context.release()
        self._opened = None

    def corrupt(self, clean: NDArray[np.uint16], name: str = "") -> Frame:
        """Add noise to depth (H, W) uint16 in steps of depth_unit_mm, 0 = none; return a Frame.

        Raises ConfigError.

        Args:
            name: of the map; the noise is a function of it and the settings' seed.
        """
        image = self.rig.intrinsics
        if clean.dtype != np.uint16 or clean.ndim != 2:
            raise ConfigError(
                f"{name or 'the depth map'}: must be one channel of 16 bits, "
                f"not {clean.shape} {clean.dtype}"
            )
        if clean.shape != (image.height, image.width):
            raise ConfigError(
                f"{name or 'the depth map'}: is {clean.shape[1]}x{clean.shape[0]}, "
                f"not {image.width}x{image.height} like the first one"
            )
        depth_m = decode_depth(clean, self._output.depth_unit_mm)
        seed = stable_seed("corrupt", self._settings.seed, name)
        key = FaceKey(name or "map", "main", 0)
        return self._corrupt(depth_m, key, DrawKeys(seed, seed, seed))

    def __call__(self, depth_m: _Depths, *, frame: int = 0, sequence: str = "") -> _Depths:
        """Return noisy depth for clean depth in metres, float arrays or tensors, 0 = no return.

        depth_m: (H, W), (B, H, W) or more leading axes, float16, float32 or float64, NumPy or
            PyTorch; also with a last axis of length 1. NaN, infinity, 0 and what lies beyond the
            sensor's far plane are no surface. The input is not changed, and not copied on the CPU.
        frame: number of the first map; map b of a batch has the noise of frame + b, alone or not.
        sequence: a name; what a stage draws per sequence or per subject is drawn once for it.
        Returns a new array or tensor of the same type and shape. Raises ConfigError, also for
        depth that is in millimetres by its range.
        """
        image = self.rig.intrinsics
        maps, results, answer = depth_batch(depth_m, (image.height, image.width))
        refuse_millimetres(maps, self.rig.near_m, self.rig.far_m)
        for number, clean in enumerate(maps):
            made = self.corrupt_depth(clean, frame=frame + number, sequence=sequence)
            results[number] = made.noisy_m
        noisy: _Depths = answer()
        return noisy

    def corrupt_depth(
        self, depth_m: NDArray[np.floating[Any]], *, frame: int = 0, sequence: str = ""
    ) -> Frame:
        """Return the whole Frame (infrared, reasons, parameters) for one (H, W) map in metres.

        Arguments as in ``__call__``, whose noise it has. Raises ConfigError.
        """
        image = self.rig.intrinsics
        if depth_m.shape != (image.height, image.width):
            raise ConfigError(
                f"depth has the shape {depth_m.shape}, the camera {image.height, image.width}"
            )
        held = stable_seed("corrupt sequence", self._settings.seed, sequence)
        seed = stable_seed("corrupt frame", self._settings.seed, sequence, frame)
        key = FaceKey(sequence or "map", "main", frame)
        return self._corrupt(
            surface_depth(depth_m, self.rig.far_m), key, DrawKeys(seed, held, held)
        )

    def _corrupt(self, depth_m: NDArray[np.float32], key: FaceKey, seeds: DrawKeys) -> Frame:
        drawn, values = draw_values(self.sensor.stages, seeds)
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
            nearest_m = float(depth_m[depth_m > 0].min())
            frame = self._frame(window, seeds, depth_m, nearest_m)
            run_twins(self.sensor.stages, layers, frame, values)
        else:
            if self._opened is None or self._opened.process != os.getpid():
                self._opened = _Graphics(self, self._backend)
            graphics = self._opened
            make_current(graphics.context)
            normal = depth_map.normals(depth_m, self.canvas.rays())
            surface = depth_map.surface(depth_m, self.canvas)
            with graphics.renderer.light_depth_map(depth_m, normal, surface) as rendered:
                frame = self._frame(rendered.window, seeds, depth_m, rendered.nearest_m)
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
            parameters=drawn,
        )

    def _frame(
        self, window: Rect, seeds: DrawKeys, depth_m: NDArray[np.float32], nearest_m: float
    ) -> FrameContext:
        # Nobody says what a map shows. Cameras expose to a mean brightness, and light falls with
        # the square of the distance.
        brightness = np.mean(depth_m[depth_m > 0].astype(np.float64) ** -2)
        return FrameContext.for_frame(
            rig=self.canvas,
            window=window,
            seed=seeds.frame,
            sequence_seed=seeds.sequence,
            device_seed=stable_seed("device", self._settings.seed, 0),
            nearest_m=nearest_m,
            subject_m=float(brightness**-0.5),
            supersample=1,  # a map has no samples
        )

    def _array_layers(self, depth_m: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """Compute the input layers of a noise chain in NumPy, without GL."""
        rays = self.rig.rays()
        albedo = np.where(depth_m > 0, np.float32(SKIN_ALBEDO), np.float32(0))
        normal = np.dstack([depth_map.normals(depth_m, rays), albedo])
        return {
            **self.sensor.images,
            "clean": depth_m,
            "depth": depth_m,
            "reason": np.zeros_like(depth_m),
            "normal": normal,
            "albedo": albedo,
            "lit": depth_map.lit_by_marching(depth_m, self.rig),
            "rays": rays,
        }


def noise_name(depth_mm: NDArray[np.float32]) -> str:
    """Return the name of a map's noise: the same for the same depths in any format and place.

    Rounding to 1/64 mm makes metres and steps alike: no step of 0.05 mm or more, and none of a
    power of 2, lies between two of these.
    """
    steps = np.rint(depth_mm * np.float32(64)).astype("<i4")
    return f"{stable_seed(depth_mm.shape, zlib.crc32(steps.tobytes())):x}"


def surface_depth(depth: NDArray[np.floating[Any]], far_m: float) -> NDArray[np.float32]:
    """Return depth as float32 metres with 0 for NaN, for values up to 0, and beyond ``far_m``.

    Simulators use any of these for the empty background. Memory is shared where nothing changes.
    """
    seen = (depth > 0) & (depth <= far_m)  # NaN compares as False
    if seen.all() and depth.dtype == np.float32:
        return np.ascontiguousarray(depth, np.float32)
    return np.where(seen, depth, 0).astype(np.float32)


def depth_batch(
    depth: Any, shape: tuple[int, int]
) -> tuple[NDArray[np.floating[Any]], NDArray[np.floating[Any]], Callable[[], Any]]:
    """View an array or tensor of float depth as a batch of maps of ``shape`` (height, width).

    PyTorch is not imported: its tensors are known by their type's module.

    Args:
        depth: (H, W), (B, H, W), more leading axes, and any of them with a last axis of length 1.

    Returns:
        (B, H, W) view of the maps, a copy only of a tensor on a GPU and of rows that are not
        contiguous; (B, H, W) view of the array to return, unset; and a function that gives that
        array in the form of the input: type, shape, number type and device.

    Raises:
        ConfigError: for whole numbers, for another size and for what is no array.
    """
    kind = str(getattr(depth, "dtype", type(depth).__name__)).removeprefix("torch.")
    if kind not in _FLOATS or not hasattr(depth, "shape"):
        raise ConfigError(
            f"depth must be an array or a tensor of float metres ({', '.join(_FLOATS)}), "
            f"not {kind}: of whole millimetres give depth.astype('float32') / 1000"
        )
    full, stack = tuple(int(side) for side in depth.shape), (-1, *shape)
    if full[-2:] != shape and full[-3:] != (*shape, 1):
        raise ConfigError(
            f"depth has the shape {full}: the camera has {shape[1]}x{shape[0]} pixels, so it must "
            f"be {shape}, (batch, {shape[0]}, {shape[1]}), or one of them with a last axis of 1"
        )
    if type(depth).__module__.partition(".")[0] != "torch":
        array = np.asarray(depth)
        answer = np.empty(full, array.dtype)
        return array.reshape(stack), answer.reshape(stack), lambda: answer
    host = depth.detach().cpu()
    made = host.new_empty(full)
    return (host.numpy().reshape(stack), made.numpy().reshape(stack), lambda: made.to(depth.device))
