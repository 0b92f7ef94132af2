"""Captures of scenes that several checks share; each is simulated once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from glsim.measures import stacks as measure
from glsim.validate import scenes
from glsim.validate.ablations import Ablations, sensor_ablations
from glsim.validate.virtual_camera import Capture, Changes, VirtualCamera

_T = TypeVar("_T")

#: Note of a check that needs the stages of a time-of-flight chain.
INTERNAL = "needs the stages of a time-of-flight chain, which this sensor lacks"


class Captures:
    """A virtual camera, the ablations of its sensor, and a cache of captures."""

    def __init__(self, camera: VirtualCamera) -> None:
        self.camera = camera
        self.ablations: Ablations = sensor_ablations(camera.sensor)
        self._walls: dict[str, Capture] = {}
        self._cache: dict[str, Any] = {}

    @property
    def scene_frames(self) -> int:
        """Number of frames of scenes in which every row or pixel is a sample."""
        return max(4, self.camera.frames // 2)

    def wall(self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None) -> Capture:
        """Capture the central 64 x 64 px of a frontal wall."""
        key = f"{z_mm} {albedo} {changes}"
        if key not in self._walls:
            capture = self.camera.capture(
                scenes.wall(z_mm, albedo), at_mm=(0, 0, z_mm), changes=changes,
                scene=f"wall {z_mm} {albedo}",
            )  # fmt: skip
            self._walls[key] = capture.centre()
        return self._walls[key]

    def spatial_sigma_mm(
        self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None
    ) -> float:
        """Spatial sigma of a wall, mm."""
        return measure.sigma_spatial(self.wall(z_mm, albedo, changes).residual_mm)

    def temporal_sigma_mm(
        self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None
    ) -> float:
        """Temporal sigma of a wall, mm, before rounding to whole mm, as it may be below 1 mm."""
        return measure.sigma_temporal(self.wall(z_mm, albedo, changes).fine_mm)

    def mean_error_mm(
        self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None
    ) -> float:
        """Mean of measured minus true depth on a wall, mm."""
        capture = self.wall(z_mm, albedo, changes)
        return measure.mean_of(capture.fine_mm - capture.clean_mm)

    def cached(self, name: str, make: Callable[[], _T]) -> _T:
        """Return the result of ``make``, which is called once for each name."""
        if name not in self._cache:
            self._cache[name] = make()
        value: _T = self._cache[name]
        return value
