"""Data transforms for training frameworks such as PyTorch.

    noise = glsim.simulation.transforms.DepthNoise("kinect-v2", p=0.9)
    noisy_m = noise(clean_m)                       # arrays of NumPy, tensors of PyTorch
    torchvision.transforms.v2.Compose([noise, ...])
    DataLoader(dataset, num_workers=4, multiprocessing_context="fork")  # or "spawn"

PyTorch is not imported. Where it is loaded, the seeds of its DataLoader's workers are used.
"""

from __future__ import annotations

import math
import os
import sys
from collections import OrderedDict
from typing import Any, Final, TypeVar

import numpy as np

from glsim.core.errors import ConfigError
from glsim.core.seeds import stable_seed
from glsim.sensors.sensor import sensor_of
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.corrupt import Corrupter

__all__ = ["DepthNoise"]

_Depths = TypeVar("_Depths")
#: Sizes of maps whose programs are kept; crops of one size are the rule.
_SIZES: Final = 4


class DepthNoise:
    """Adds a sensor's noise to depth maps, with new noise in each call.

    It may be pickled, and used in forked and spawned workers: each opens a GL context of its own
    with its first map. Calls draw other noise in each worker and in each epoch. The noise is a
    function of ``seed``, the seed of the worker (so of ``torch.manual_seed``) and the number of
    maps before in the process; with ``frame`` it is one of ``seed``, ``sequence`` and ``frame``.

    Args:
        sensor: a shipped sensor, a sensor file, or whole settings (``glsim.load_settings``).
        p: probability that a call changes the maps, 0 to 1.
        seed: of the noise.
        backend: "egl", "osmesa", "numpy" (the twins, without OpenGL) or None (a GL that works).
        focal_px: (x, y) of the camera that made the maps; default: the sensor's.
        centre_px: (x, y) of its principal point; default: the sensor's, or the middle of crops.

    Raises:
        ConfigError: for an unknown sensor, and a probability outside of 0 to 1.
    """

    def __init__(
        self,
        sensor: str | Settings = "kinect-v2",
        p: float = 1.0,
        *,
        seed: int = 0,
        backend: str | None = None,
        focal_px: tuple[float, float] | None = None,
        centre_px: tuple[float, float] | None = None,
    ) -> None:
        if not 0.0 <= p <= 1.0:
            raise ConfigError(f"p {p}: is a probability, 0 to 1")
        settings = (
            load_settings(overrides={"sensor": sensor}) if isinstance(sensor, str) else sensor
        )
        self.settings = settings.model_copy(update={"seed": seed})
        sensor_of(self.settings)  # now, not in a worker
        self.p = p
        self._camera = backend, focal_px, centre_px
        self._forget()

    def __call__(
        self, depth_m: _Depths, *, frame: int | None = None, sequence: str = ""
    ) -> _Depths:
        """Return noisy depth of the same type and shape as the clean depth.

        Args:
            depth_m: (H, W), (1, H, W), (B, 1, H, W) or other leading axes: metres, float16, float32
                or float64, 0 = no surface; see ``Corrupter``. The input is not changed.
            frame: makes the noise repeatable: map b of a batch has that of frame + b.
            sequence: of ``frame``: what is drawn per device and sequence is drawn once for it.

        Raises:
            ConfigError: for whole numbers, millimetres, and what is no depth map.
        """
        shape: tuple[int, ...] = getattr(depth_m, "shape", ())
        if len(shape) < 2:
            raise ConfigError(f"depth must be an array or a tensor (..., H, W), not {shape}")
        if frame is None:
            sequence, frame = self._next(math.prod(shape[:-2]))
        chance = np.random.default_rng(stable_seed("p", self.settings.seed, sequence, frame))
        if chance.random() >= self.p:
            return depth_m
        size = int(shape[-2]), int(shape[-1])
        return self._corrupter(size)(depth_m, frame=frame, sequence=sequence)

    def __repr__(self) -> str:
        return f"DepthNoise({self.settings.sensor!r}, p={self.p:g}, seed={self.settings.seed})"

    def __getstate__(self) -> dict[str, Any]:
        """Return the settings only; GL contexts and counters stay in their process."""
        return {"settings": self.settings, "p": self.p, "_camera": self._camera}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._forget()

    def _forget(self) -> None:
        self._by_size: OrderedDict[tuple[int, int], Corrupter] = OrderedDict()
        self._process = os.getpid()
        self._maps: dict[str, int] = {}

    def _next(self, maps: int) -> tuple[str, int]:
        """Return a name for this worker and epoch, and the number of maps before this call."""
        if self._process != os.getpid():  # forked: the parent's maps are not ours
            self._forget()
        torch = sys.modules.get("torch")
        info = None if torch is None else torch.utils.data.get_worker_info()
        worker = "here" if info is None else f"worker {info.seed}"  # another one in each epoch
        number = self._maps.get(worker, 0)
        self._maps = {worker: number + maps}
        return worker, number

    def _corrupter(self, size: tuple[int, int]) -> Corrupter:
        if size not in self._by_size:
            self._by_size[size] = Corrupter(self.settings, size, *self._camera)
            if len(self._by_size) > _SIZES:
                _, oldest = self._by_size.popitem(last=False)
                oldest.__exit__()
        self._by_size.move_to_end(size)
        return self._by_size[size]
