"""Captures of scenes that several checks share; each is simulated once."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from glsim.bench.measures import stacks as measure
from glsim.bench.validate import scenes
from glsim.bench.validate.virtual_camera import Changes, VirtualCamera
from glsim.core.depth_frame import Frames
from glsim.sensors.sensor import Sensor

_T = TypeVar("_T")

#: Note of a check that needs the stages of a time-of-flight chain.
INTERNAL = "needs the stages of a time-of-flight chain, which this sensor lacks"

OFF = {"enabled": 0.0}
_SKIN = {"subsurface_mm": 7.0}


@dataclass(frozen=True)
class Ablations:
    """Changes to a chain that a check makes; None where the chain has no such part.

    Args:
        white: keeps only the noise of the phases (no floor, no fixed pattern, no rounding).
        no_filters: keeps the decoder's thresholds but none of its filters.
        no_rounding: depth stays a real number.
        no_light_noise: taps measure light exactly.
        skin: adds the delay of light within skin.
        phases: names of the layers that hold the phasors, real and imaginary part of 80 and 16 MHz
            and of 120 MHz.
    """

    white: Changes | None = None
    no_filters: Changes | None = None
    no_rounding: Changes | None = None
    no_light_noise: Changes | None = None
    skin: Changes | None = None
    phases: tuple[str, ...] = ()


def sensor_ablations(sensor: Sensor) -> Ablations:
    """List the ablations that a sensor allows, by the names of the shipped stages in its chain."""
    names = {stage.spec.name: stage.name for stage in sensor.stages}

    def changes(**by_spec: Mapping[str, float]) -> Changes | None:
        """Keep the changes to stages that the sensor has; None if it has none of them."""
        kept = {names[spec]: dict(values) for spec, values in by_spec.items() if spec in names}
        return kept or None

    rounding = changes(millimetre_quantise=OFF)
    straight = {"harmonic_2": 0.0, "harmonic_5": 0.0}
    white = {"fixed_pattern": OFF, "millimetre_quantise": OFF}
    if "tof_fast" in names:
        return Ablations(
            white=changes(tof_fast={**straight, "sigma_mm": 0.0, "lateral_px": 0.0}, **white),
            no_rounding=rounding,
            skin=changes(tof_fast=_SKIN),
        )
    if "tof_taps" not in names:
        return Ablations(no_rounding=rounding)
    return Ablations(
        white=changes(tof_light=straight, tof_floor=OFF, **white),
        no_filters=changes(tof_bilateral=OFF, tof_edge=OFF),
        no_rounding=rounding,
        no_light_noise=changes(
            tof_taps={"read_variance": 0.0, "shot_variance": 0.0, "companding": 0.0}
        ),
        skin=changes(tof_light=_SKIN),
        phases=("phasor_a", "phasor_b"),
    )


class Captures:
    """A virtual camera, the ablations of its sensor, and a cache of captures."""

    def __init__(self, camera: VirtualCamera) -> None:
        self.camera = camera
        self.ablations: Ablations = sensor_ablations(camera.sensor)
        self._cache: dict[str, Any] = {}

    @property
    def scene_frames(self) -> int:
        """Number of frames of scenes in which every row or pixel is a sample."""
        return max(4, self.camera.frames // 2)

    @property
    def focal_baseline_px_mm(self) -> float:
        """Focal length times baseline, px mm."""
        return 1000.0 * self.camera.rig.intrinsics.fx * self.camera.rig.baseline_m

    def wall(self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None) -> Frames:
        """Capture the central 64 x 64 px of a frontal wall."""
        name = f"wall {z_mm} {albedo}"
        return self.cached(
            f"{name} {changes}",
            lambda: self.camera.capture(
                scenes.wall(z_mm, albedo), at_mm=(0, 0, z_mm), changes=changes, scene=name
            ).centre(),
        )

    def tilted(self, angle_deg: float) -> Frames:
        """Capture 64 x 8 px of a strip at 0.9 m that is turned about the x axis.

        This axis makes the angle of the light equal to that of the view; at 80 degrees one row
        spans 14 mm of depth.
        """
        return self.camera.capture(
            scenes.tilted(900, angle_deg), self.scene_frames, at_mm=(0, 0, 900),
            scene=f"tilt {angle_deg}",
        ).centre(64, 8)  # fmt: skip

    def valid_percent(self, z_mm: float, albedo: float = 1.0) -> float:
        """Return the share of pixels of a small wall that have depth, percent."""
        capture = self.camera.capture(
            scenes.wall(z_mm, albedo), 8, 24, at_mm=(0, 0, z_mm), scene=f"range {z_mm}"
        )
        return 100.0 * measure.valid_share(capture.measured_mm)

    def levels_on_ramp(self) -> int:
        """Count the depths in whole mm on a ramp of 10 cm at 3 m; 101 if none is missing."""
        ramp = scenes.ten_centimetres(self.camera.rig.intrinsics.fx)
        whole = self.camera.capture(ramp, crop=96, scene="ramp").whole_mm
        return len(set(whole[(whole >= 2950) & (whole <= 3050)].tolist()))

    def spatial_sigma_mm(self, z_mm: float, albedo: float = 1.0) -> float:
        """Spatial sigma of a wall, mm."""
        return measure.sigma_spatial(self.wall(z_mm, albedo).residual_mm)

    def temporal_sigma_mm(
        self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None
    ) -> float:
        """Temporal sigma of a wall, mm, before rounding to whole mm, as it may be below 1 mm."""
        return measure.sigma_temporal(self.wall(z_mm, albedo, changes).measured_mm)

    def mean_error_mm(
        self, z_mm: float, albedo: float = 1.0, changes: Changes | None = None
    ) -> float:
        """Mean of measured minus true depth on a wall, mm."""
        capture = self.wall(z_mm, albedo, changes)
        return measure.mean_of(capture.measured_mm - capture.truth_mm)

    def cached(self, name: str, make: Callable[[], _T]) -> _T:
        """Return the result of ``make``, which is called once for each name."""
        if name not in self._cache:
            self._cache[name] = make()
        value: _T = self._cache[name]
        return value
