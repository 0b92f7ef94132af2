"""Add sensor noise to the user's own clean depth maps."""

from __future__ import annotations

from types import TracebackType

import numpy as np
from numpy.typing import NDArray

from glsim.errors import ConfigError
from glsim.faces.base import FaceKey
from glsim.frame import Frame, decode_depth
from glsim.frame_assembly import assemble_frame
from glsim.geometry import depth_map
from glsim.geometry.mesh import SKIN_ALBEDO
from glsim.geometry.rect import Rect
from glsim.gl.context import make_current, open_context
from glsim.gl.targets import Readback
from glsim.noise.chain import (
    PATTERN_LAYER,
    ShaderChain,
    pattern_layer,
    run_array_stages,
    run_twins,
)
from glsim.noise.frame_context import FrameContext
from glsim.noise.stage import draw_values
from glsim.render.renderer import Renderer
from glsim.sensors.pattern_map import check_shape
from glsim.sensors.sensor import sensor_of
from glsim.settings.distribution import DrawKeys
from glsim.settings.schema import OutputSettings, Settings
from glsim.settings.seeds import stable_seed


class Corrupter:
    """A sensor's noise chain for depth maps of one size. Use it as a context manager.

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
        self._settings = settings
        self.sensor = sensor_of(settings)
        self.rig = self.sensor.rig.for_map(shape, focal_px, centre_px)
        self._pattern_mm = None
        if self.sensor.pattern_map is not None:
            self._pattern_mm = self.sensor.pattern_map.error_mm
            check_shape(self._pattern_mm, shape, str(self.sensor.pattern_map.file))
        self._output = OutputSettings(depth_unit_mm=settings.output.depth_unit_mm)
        self._context = None if backend == "numpy" else open_context(backend)
        if self._context is not None:
            self._renderer = Renderer(self._context, self.rig)
            self._chain = ShaderChain(
                self._context, self.sensor.stages, pattern_mm=self._pattern_mm
            )
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
        """Return a Frame with noise for (H, W) uint16 depth in steps of depth_unit_mm, 0 = none.

        name: of the map; the noise is a function of it and the settings' seed. Raises ConfigError.
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
        if not depth_m.any():  # an empty map has no surface to light
            layers = dict.fromkeys(("clean", "depth", "reason"), np.zeros_like(depth_m))
        elif self._context is None:
            layers = self._array_layers(depth_m)
            frame = self._frame(window, seed, float(depth_m[depth_m > 0].min()))
            run_twins(self.sensor.stages, layers, frame, values)
        else:
            make_current(self._context)
            normal = depth_map.normals(depth_m, self.rig.rays())
            surface = depth_map.surface(depth_m, self.rig)
            with self._renderer.light_depth_map(depth_m, normal, surface) as rendered:
                frame = self._frame(rendered.window, seed, rendered.nearest_m)
                self._chain.run(rendered, frame, values, self._readback)
            layers = self._readback.arrays()
            run_array_stages(self.sensor.stages, layers, frame, values)
        return assemble_frame(
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

    def _frame(self, window: Rect, seed: int, nearest_m: float) -> FrameContext:
        return FrameContext.for_frame(
            rig=self.rig,
            window=window,
            seed=seed,
            sequence_seed=seed,
            device_seed=stable_seed("device", self._settings.seed, 0),
            nearest_m=nearest_m,
            supersample=1,  # a map has no samples
        )

    def _array_layers(self, depth_m: NDArray[np.float32]) -> dict[str, NDArray[np.float32]]:
        """Compute the layers that a chain starts from, without GL."""
        rays = self.rig.rays()
        albedo = np.where(depth_m > 0, np.float32(SKIN_ALBEDO), np.float32(0))
        normal = np.dstack([depth_map.normals(depth_m, rays), albedo])
        own = {} if self._pattern_mm is None else {PATTERN_LAYER: pattern_layer(self._pattern_mm)}
        return {
            **own,
            "clean": depth_m,
            "depth": depth_m,
            "reason": np.zeros_like(depth_m),
            "normal": normal,
            "albedo": albedo,
            "lit": depth_map.lit_by_marching(depth_m, self.rig),
            "rays": rays,
        }
