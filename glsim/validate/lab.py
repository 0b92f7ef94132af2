"""What the checks of a sensor share: its bench, which knobs its chain has, walls taken once."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from glsim.validate import measure, scenes
from glsim.validate.bench import Bench, Changes, Shots
from glsim.validate.knobs import Knobs, knobs_of

_T = TypeVar("_T")

#: Why a check of a chain's inside does not apply.
INTERNAL = "looks into a time-of-flight chain that this sensor does not have"


class Lab:
    """A bench with memory."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench
        self.knobs: Knobs = knobs_of(bench.sensor)
        self._walls: dict[str, Shots] = {}
        self._made: dict[str, Any] = {}

    @property
    def many(self) -> int:
        """Frames of scenes whose every row or pixel is a sample."""
        return max(4, self.bench.frames // 2)

    def wall(self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None) -> Shots:
        """The central 64 x 64 px of a frontal wall."""
        key = f"{z_mm} {albedo} {changes}"
        if key not in self._walls:
            shots = self.bench.shoot(
                scenes.wall(z_mm, albedo), at_mm=(0, 0, z_mm), changes=changes,
                scene=f"wall {z_mm} {albedo}",
            )  # fmt: skip
            self._walls[key] = shots.centre()
        return self._walls[key]

    def sigma_s(self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None) -> float:
        """Spatial sigma of a wall, mm."""
        return measure.sigma_spatial(self.wall(z_mm, albedo, changes).residual_mm)

    def sigma_t(self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None) -> float:
        """Temporal sigma of a wall, mm; before rounding to files, for the smallest are below it."""
        return measure.sigma_temporal(self.wall(z_mm, albedo, changes).fine_mm)

    def mean_error(self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None) -> float:
        """Mean of measured minus true depth on a wall, mm."""
        shots = self.wall(z_mm, albedo, changes)
        return measure.mean_of(shots.fine_mm - shots.clean_mm)

    def once(self, name: str, make: Callable[[], _T]) -> _T:
        """What ``make`` returns, made at the first call with this name."""
        if name not in self._made:
            self._made[name] = make()
        made: _T = self._made[name]
        return made
