"""Sensor noise on a clean depth map that the user already has."""

from __future__ import annotations

from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from glsim import depthmap
from glsim.config import OutputSettings, Settings
from glsim.distribution import DrawKeys
from glsim.errors import ConfigError
from glsim.faces.base import FaceKey
from glsim.finish import finish
from glsim.frame import Frame, Rect, decode_depth
from glsim.gl.context import make_current, open_context
from glsim.gl.targets import Readback
from glsim.mesh import SKIN_ALBEDO
from glsim.noise.chain import ShaderChain, run_array_stages, run_twins
from glsim.noise.view import FrameContext, Optics
from glsim.pipeline import draw_values
from glsim.plan import stable_seed
from glsim.render import Renderer
from glsim.sensor import sensor_of


class Corrupter:
    """A sensor's noise chain for depth maps of one size. Use as a context manager.

    settings: sensor, seed, stage parameters and output.depth_unit_mm are used.
    backend: "egl", "osmesa", "numpy" (the twins; no GL at all) or None (a GL backend that works).
    centre_px, focal_px: of the camera that made the maps; by default the sensor's own for maps of
        the sensor's size, and for others (crops) its focal length and the map's centre.
    """

    def __init__(
        self,
        settings: Settings,
        shape: tuple[int, int],
        backend: str | None = None,
        focal_px: tuple[float, float] | None = None,
        centre_px: tuple[float, float] | None = None,
    ) -> None:
        self._settings = settings
        self.sensor = sensor_of(settings)
        self.rig = self.sensor.rig.for_map(shape, focal_px, centre_px)
        self._output = OutputSettings(depth_unit_mm=settings.output.depth_unit_mm)
        self._context = None if backend == "numpy" else open_context(backend)
        if self._context is not None:
            self._renderer = Renderer(self._context, self.rig)
            self._chain = ShaderChain(self._context, self.sensor.stages)
            self._readback = Readback(self._context)

    def __enter__(self) -> Corrupter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if self._context is not None:
            self._context.release()

    def corrupt(self, clean: NDArray[np.uint16], name: str = "") -> Frame:
        """(H, W) uint16 depth in steps of depth_unit_mm (0 = none) to a Frame.

        name: of the map; with the settings' seed it decides the noise. Raises ConfigError.
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
        drawn, values = draw_values(self.sensor.stages, DrawKeys(seed, seed, seed))
        window = Rect(0, 0, image.width, image.height)
        context = FrameContext(
            window,
            image.width,
            image.height,
            seed,
            seed,
            stable_seed("device", self._settings.seed, 0),
            0.0,
            image.fx * self.rig.baseline_m,
            Optics.of(self.rig, float(depth_m[depth_m > 0].min(initial=np.inf)), supersample=1),
        )
        if not depth_m.any():  # nothing to see, nothing to light
            layers = dict.fromkeys(("clean", "depth", "reason"), np.zeros_like(depth_m))
        elif self._context is None:
            layers = self._array_layers(depth_m)
            run_twins(self.sensor.stages, layers, context, values)
        else:
            make_current(self._context)
            seen = self._renderer.light_depth_map(
                depth_m,
                depthmap.normals(depth_m, self.rig.rays()),
                depthmap.surface(depth_m, self.rig),
            )
            self._chain.run(self._renderer, seen, context, values, self._readback)
            layers = self._readback.arrays()
            run_array_stages(self.sensor.stages, layers, context, values)
        return finish(
            layers,
            window,
            window,
            image,
            self._output,
            key=FaceKey(name or "map", "main", 0),
            source="depth map",
            seed=seed,
            parameters=drawn,
        )

    def _array_layers(self, depth_m: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """The layers that a chain starts from, without GL."""
        rays = self.rig.rays()
        albedo = np.where(depth_m > 0, np.float32(SKIN_ALBEDO), np.float32(0))
        normal = np.dstack([depthmap.normals(depth_m, rays), albedo])
        return {
            "clean": depth_m,
            "depth": depth_m,
            "reason": np.zeros_like(depth_m),
            "normal": normal,
            "albedo": albedo,
            "lit": depthmap.lit_by_marching(depth_m, self.rig),
            "rays": rays,
        }
