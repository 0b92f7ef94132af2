"""Noise of a sensor on the user's own depth maps: NumPy arrays, PyTorch tensors, batches.

    noise = glsim.DepthNoise("kinect-v2", p=0.9)
    noisy_m = noise(clean_m)                       # drawn by OpenGL, map by map
    torchvision.transforms.v2.Compose([noise, ...])
    DataLoader(dataset, num_workers=4, multiprocessing_context="fork")  # or "spawn"

    noise = glsim.DepthNoise("kinect-v2-fast", device="cuda")
    noisy_m = noise(depth_m, seeds=environments, frame=step)  # whole batches, on the device

PyTorch is not imported for arrays. If it is loaded, the seeds of its DataLoader's workers are used.
"""

from __future__ import annotations

import os
import sys
from collections import OrderedDict
from typing import Any, Final, TypeVar

import numpy as np

from glsim.core.array_types import Reals
from glsim.core.camera import SensorRig
from glsim.core.errors import ConfigError, require_package
from glsim.core.seeds import stable_seed
from glsim.faces.face_source import FaceKey
from glsim.noise.array_chain import without_tensors
from glsim.sensors.sensor import sensor_of
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.corrupt import MapEngine, depth_batch, map_shape, surface_depth
from glsim.simulation.frame import Frame, refuse_millimetres

#: An array of NumPy or a tensor of PyTorch.
_Depths = TypeVar("_Depths")
#: Number of map sizes whose programs are kept; most users have crops of one size.
_SIZES: Final = 4
_BACKENDS: Final = ("egl", "osmesa", "numpy", "torch")


class DepthNoise:
    """Adds a sensor's noise to depth maps, with new noise in each call, or repeatable noise.

    Without ``frame``, the noise is a function of the seed, the seed of a DataLoader's worker (and
    so of ``torch.manual_seed``) and the number of earlier maps in the process. With ``frame`` it is
    a function of the seed, ``sequence`` and ``frame``. With ``seeds`` it is a function of the seed,
    the map's seed and the frame.

    It can be pickled, and used in forked and spawned workers: each worker opens a GL context with
    its first map. Use it as a context manager to release the contexts at the end of a block.

    Args:
        sensor: a shipped sensor, a sensor file, or whole settings (``glsim.load_settings``).
        p: probability that a call changes the maps (with ``seeds``: that a map is changed).
        seed: seed of the noise; default: the seed in the settings.
        backend: "egl" or "osmesa" (OpenGL, map by map), "numpy" (the twins, map by map), "torch"
            (whole batches on their device). Default: "torch" if ``device`` or ``seeds`` are given,
            and for tensors on a GPU if the sensor's stages take them; otherwise OpenGL.
        device: device of the returned tensors, for "torch"; default: the device of the depth.
        focal_px: focal lengths (x, y) of the camera that made the maps; default: the sensor's.
        centre_px: principal point (x, y) of that camera; default: the sensor's for maps of its
            size, otherwise the centre of the map.

    Raises ConfigError: an unknown sensor or backend, or a probability outside of 0 to 1.
    """

    def __init__(
        self,
        sensor: str | Settings = "kinect-v2",
        p: float = 1.0,
        *,
        seed: int | None = None,
        backend: str | None = None,
        device: Any = None,
        focal_px: tuple[float, float] | None = None,
        centre_px: tuple[float, float] | None = None,
    ) -> None:
        if not isinstance(sensor, str | Settings):
            raise ConfigError(f"sensor {sensor!r}: give a name, a .toml file, or Settings")
        if not 0.0 <= p <= 1.0:
            raise ConfigError(f"p {p}: is a probability, 0 to 1")
        if backend not in (None, *_BACKENDS):
            raise ConfigError(f"backend {backend!r}: is one of {', '.join(_BACKENDS)}, or None")
        if device is not None and backend not in (None, "torch"):
            raise ConfigError(f'backend {backend!r} has no device: leave it out, or take "torch"')
        if isinstance(sensor, str):
            sensor = load_settings(overrides={"sensor": sensor})
        own_seed = sensor.seed if seed is None else seed
        self.settings = sensor.model_copy(update={"seed": own_seed})
        stages = sensor_of(self.settings).stages  # errors appear here, not in a worker
        self._takes_tensors = without_tensors(stages) is None
        self.p, self.device = p, device
        self._backend = "torch" if device is not None else backend
        self._camera = focal_px, centre_px
        self._size: tuple[int, int] | None = None
        self._forget()

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
        **options: Any,
    ) -> DepthNoise:
        """Make the noise for the images of one size from another simulator's camera.

        Args:
            sensor: gives noise, emitters and clip planes; the camera replaces its intrinsics.
            width, height, fx, fy, cx, cy: the simulator's pinhole camera, pixels.
            first_pixel: coordinate of the first pixel's centre in the convention of cx and cy: 0.5
                if the image reaches from 0 to its width (cx = width / 2: the middle), 0 in ROS.

        Raises ConfigError: the camera or an option is wrong.
        """
        if first_pixel not in (0, 0.5):
            raise ConfigError(f"first_pixel {first_pixel}: is 0 (OpenCV, ROS) or 0.5")
        shift = 0.5 - first_pixel
        centre = cx + shift, cy + shift
        noise = cls(sensor, focal_px=(fx, fy), centre_px=centre, **options)
        noise._size = height, width
        noise._engine(noise._size, noise._backend)
        return noise

    def __enter__(self) -> DepthNoise:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Release the OpenGL contexts; the next call opens new ones."""
        for engine in self._engines.values():
            if isinstance(engine, MapEngine):
                engine.close()
        self._forget()

    def __call__(
        self,
        depth_m: _Depths,
        *,
        frame: Any = None,
        sequence: str = "",
        seeds: Any = None,
        **given: Any,
    ) -> _Depths:
        """Return noisy depth of the same type and shape as the clean depth.

        The gradient with respect to the pixel's clean depth is 1, of a lost pixel 0 ("torch").

        Args:
            depth_m: clean depth, metres, float16, float32 or float64. Shapes are (H, W), (1, H, W),
                (B, 1, H, W) or others with leading axes; a last axis of 1 is allowed. 0, NaN,
                infinity and depths beyond the sensor's far plane are no surface. The input stays.
            frame: makes the noise repeatable: map b of a batch has the noise of ``frame + b``. With
                ``seeds``: the frame of all maps, or (B,) one for each map; default 0.
            sequence: name of the sequence of ``frame``. Numbers that are sampled per sequence or
                device are sampled once for it.
            seeds: (B,) integers of 32 bits, for instance one per environment; "torch" only. Each
                seed is a device, whose parameters are sampled from the sensor's distributions.
            given: for "torch" only: fx, fy, cx and cy of the maps, pixels, numbers or (B,), with
                the first pixel's centre at 0.5; normal, (B, H, W, 3) towards the camera; albedo,
                (B, H, W).

        Raises ConfigError: whole numbers, millimetres, or another shape or type.
        """
        shape, count = map_shape(depth_m, self._size)
        if seeds is None:
            if frame is None:
                sequence, frame = self._next(count)
            chance = np.random.default_rng(stable_seed("p", self.settings.seed, sequence, frame))
            if self.p < 1 and chance.random() >= self.p:
                return depth_m
        if self.backend_for(depth_m, seeds) == "torch":
            changed: _Depths = self._on_tensors(depth_m, frame, sequence, seeds, **given)[0]
            return changed
        if seeds is not None or given:
            names = ", ".join(["seeds"] * (seeds is not None) + sorted(given))
            raise ConfigError(f'{names}: only with backend="torch"')
        maps, results, answer = depth_batch(depth_m, shape)
        engine = self._engine(shape, self._backend)
        refuse_millimetres(maps, engine.rig.near_m, engine.rig.far_m)
        for number, clean in enumerate(maps):
            results[number] = self._frame(engine, clean, frame + number, sequence).noisy_m
        noisy: _Depths = answer()
        return noisy

    def layers(
        self,
        depth_m: Any,
        *,
        frame: Any = None,
        sequence: str = "",
        seeds: Any = None,
        **given: Any,
    ) -> dict[str, Any]:
        """Return the layers that the camera measures of a batch, tensors (B, H, W), by "torch".

        The layers are depth (noisy, metres), reason (uint8 codes of ``glsim.Reason``), infrared
        (counts) and expected (metres, with the device's systematic error but without noise). The
        arguments and errors are those of a call. All maps are changed, whatever ``p`` is.
        """
        if self._backend not in (None, "torch"):
            raise ConfigError(f'layers: only with backend="torch", not {self._backend!r}')
        if seeds is None and frame is None:
            sequence, frame = self._next(map_shape(depth_m, self._size)[1])
        return self._on_tensors(depth_m, frame, sequence, seeds, expected=True, **given)[1]

    def corrupt_depth(self, depth_m: Reals, *, frame: int = 0, sequence: str = "") -> Frame:
        """Return the Frame (infrared, reasons, ...) of an (H, W) map, m, by OpenGL or NumPy."""
        shape = (depth_m.shape[0], depth_m.shape[1]) if depth_m.ndim == 2 else (0, 0)
        if depth_m.ndim != 2 or self._size not in (None, shape):
            raise ConfigError(f"depth has the shape {depth_m.shape}, the camera {self._size}")
        backend = None if self._backend == "torch" else self._backend
        return self._frame(self._engine(shape, backend), depth_m, frame, sequence)

    def rig(self, shape: tuple[int, int] | None = None) -> SensorRig:
        """Return the sensor's rig for maps of shape (height, width); default: for_camera's."""
        size = shape or self._size
        if size is None:
            raise ConfigError("rig: give the shape of the maps, (height, width)")
        return sensor_of(self.settings).rig.for_map(size, *self._camera)

    def backend_for(self, depth_m: Any, seeds: Any = None) -> str:
        """Choose the backend of a call: "torch", "numpy", "egl", "osmesa" or "gl"."""
        tensor = type(depth_m).__module__.partition(".")[0] == "torch"
        on_gpu = tensor and depth_m.device.type != "cpu" and self._takes_tensors
        return self._backend or ("torch" if on_gpu or seeds is not None else "gl")

    def __repr__(self) -> str:
        backend = f", backend={self._backend!r}" if self._backend else ""
        return (
            f"DepthNoise({self.settings.sensor!r}, p={self.p:g}, "
            f"seed={self.settings.seed}{backend})"
        )

    def __getstate__(self) -> dict[str, Any]:
        """Return the settings only; GL contexts and counters stay in their process."""
        names = ("settings", "p", "device", "_backend", "_camera", "_size", "_takes_tensors")
        return {name: self.__dict__[name] for name in names}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._forget()

    def _forget(self) -> None:
        self._engines: OrderedDict[Any, Any] = OrderedDict()
        self._process = os.getpid()
        self._maps: dict[str, int] = {}

    def _next(self, maps: int) -> tuple[str, int]:
        """Return a name for this worker and epoch, and the number of maps before this call."""
        if self._process != os.getpid():  # forked: the parent's maps are not ours
            self._forget()
        torch = sys.modules.get("torch")
        info = None if torch is None else torch.utils.data.get_worker_info()
        worker = "here" if info is None else f"worker {info.seed}"  # changes with each epoch
        number = self._maps.get(worker, 0)
        self._maps = {worker: number + maps}
        return worker, number

    def _engine(self, size: tuple[int, int], backend: str | None) -> Any:
        key = size, backend
        if key not in self._engines:
            if backend == "torch":
                require_package("torch", "noise on tensors", "train")
                from glsim.simulation.tensor_engine import TensorEngine

                made: Any = TensorEngine(sensor_of(self.settings), self.rig(size))
            else:
                made = MapEngine(self.settings, size, backend, *self._camera)
            self._engines[key] = made
            if len(self._engines) > _SIZES:
                self._engines.popitem(last=False)  # a MapEngine's finalizer closes it
        self._engines.move_to_end(key)
        return self._engines[key]

    def _keys(self, frame: int, sequence: str) -> ScopeSeeds:
        held = stable_seed("corrupt sequence", self.settings.seed, sequence)
        own = stable_seed("corrupt frame", self.settings.seed, sequence, frame)
        return ScopeSeeds(own, held, held)

    def _frame(self, engine: MapEngine, depth_m: Any, frame: int, sequence: str) -> Frame:
        key = FaceKey(sequence or "map", "main", frame)
        clean = surface_depth(depth_m, engine.rig.far_m)
        return engine.frame(clean, key, self._keys(frame, sequence))

    def _on_tensors(
        self, depth_m: Any, frame: Any, sequence: str, seeds: Any, **given: Any
    ) -> tuple[Any, dict[str, Any]]:
        size, count = map_shape(depth_m, self._size)
        keys, engine = None, self._engine(size, "torch")
        if seeds is None:
            keys = [self._keys(frame + number, sequence) for number in range(count)]
        else:
            given |= {"seeds": seeds, "frames": 0 if frame is None else frame}
        made: tuple[Any, dict[str, Any]] = engine.measure(
            depth_m, self.device, keys, self.settings.seed, self.p, **given
        )
        return made
