"""Captures of scenes that several checks share, each simulated once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from glsim.bench import scenes
from glsim.core.depth_frame import Frames
from glsim.core.units import MM_PER_M
from glsim.measures import stacks as measure
from glsim.settings.toml_tables import read_toml
from glsim.simulation.virtual_camera import Changes, VirtualCamera

_T = TypeVar("_T")
#: Note of a check that needs the stages of a time-of-flight chain.
INTERNAL = "needs the stages of a time-of-flight chain, which this sensor lacks"

OFF = {"enabled": 0.0}
#: Layers with the phasors (real and imaginary part) of a chain with ``tof_taps``: the first for 80
#: and 16 MHz, the second for 120 MHz.
PHASES = ("phasor_a", "phasor_b")
#: Name of a change to a chain -> "needs": one of these stages; "stage": its new parameters.
_ABLATIONS = read_toml(Path(__file__).with_name("ablations.toml"))


class Captures:
    """A virtual camera with a cache of captures; ``decimated_by``: see ``ValidationSheet``."""

    def __init__(self, camera: VirtualCamera, decimated_by: int = 1) -> None:
        self.camera, self.decimated_by = camera, decimated_by
        self._cache: dict[str, Any] = {}

    def ablation(self, name: str) -> Changes | None:
        """Return an entry of _ABLATIONS as changes of stages; None if it changes no stage."""
        names = {stage.spec.name: stage.name for stage in self.camera.sensor.stages}
        change = _ABLATIONS[name]
        if names.keys().isdisjoint(change["needs"]):
            return None
        return {names[stage]: new for stage, new in change["stage"].items() if stage in names}

    @property
    def scene_frames(self) -> int:
        """Number of frames for scenes in which every row or pixel is a sample."""
        return max(4, self.camera.frames // 2)

    @property
    def focal_baseline_px_mm(self) -> float:
        """Focal length times baseline, px mm."""
        return MM_PER_M * self.camera.rig.intrinsics.fx * self.camera.rig.baseline_m

    def wall(self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None) -> Frames:
        """Capture the central 64 x 64 px of a frontal wall."""
        name = f"wall {z_mm} {albedo}"
        return self.cached(
            f"{name} {changes}",
            lambda: self.camera.capture(
                scenes.wall(z_mm, albedo), changes=changes, scene=name
            ).centre(),
        )

    def valid_percent(self, z_mm: float, albedo: float = 1.0) -> float:
        """Measure the share of pixels with depth on a small wall, percent."""
        capture = self.camera.capture(scenes.wall(z_mm, albedo), 8, 24, scene=f"range {z_mm}")
        return 100.0 * float(np.isfinite(capture.measured_mm).mean())

    def levels_on_ramp(self) -> int:
        """Count the different whole mm on a ramp of 10 cm at 3 m; 101 if no mm is missing."""
        # The ramp spans 12 cm over 88 px; 10 cm of it are counted.
        ramp = scenes.depth_ramp(3000.0, 44 * 3000.0 / self.camera.rig.intrinsics.fx, 60.0)
        whole = self.camera.capture(ramp, crop=96, scene="ramp").whole_mm
        return len(set(whole[(whole >= 2950) & (whole <= 3050)].tolist()))

    def spatial_sigma_mm(self, z_mm: float, albedo: float = 1.0) -> float:
        """Measure the spatial sigma of a wall, mm."""
        return measure.sigma_spatial(self.wall(z_mm, albedo).residual_mm)

    def temporal_sigma_mm(
        self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None
    ) -> float:
        """Measure a wall's temporal sigma, mm, before rounding, since it may be below 1 mm."""
        return measure.sigma_temporal(self.wall(z_mm, albedo, changes).measured_mm)

    def mean_error_mm(
        self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None
    ) -> float:
        """Measure the mean of measured minus true depth on a wall, mm."""
        capture = self.wall(z_mm, albedo, changes)
        return measure.mean_of(capture.measured_mm - capture.truth_mm)

    def cached(self, name: str, make: Callable[[], _T]) -> _T:
        """Return the result of ``make``, which is called only once per name."""
        if name not in self._cache:
            self._cache[name] = make()
        value: _T = self._cache[name]
        return value
