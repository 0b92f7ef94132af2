"""Ablations: parts of a sensor's chain that a check switches off or changes.

Stages are found by the names of the shipped ones, so that a user's sensor made of shipped stages
has the same ablations.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from glsim.sensors.sensor import Sensor
from glsim.validate.virtual_camera import Changes

_OFF = {"enabled": 0.0}
_SKIN = {"subsurface_mm": 7.0}


@dataclass(frozen=True)
class Ablations:
    """Changes to a chain; None where the chain has no such part.

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
    """List the ablations that the stages of a sensor allow."""
    names = {stage.spec.name: stage.name for stage in sensor.stages}

    def changes(**by_spec: Mapping[str, float]) -> Changes | None:
        """Keep the changes to stages that the sensor has; None if it has none of them."""
        kept = {names[spec]: dict(values) for spec, values in by_spec.items() if spec in names}
        return kept or None

    rounding = changes(millimetre_quantise=_OFF)
    straight = {"harmonic_2": 0.0, "harmonic_5": 0.0}
    white = {"fixed_pattern": _OFF, "millimetre_quantise": _OFF}
    if "tof_fast" in names:
        return Ablations(
            white=changes(tof_fast={**straight, "sigma_mm": 0.0, "lateral_px": 0.0}, **white),
            no_rounding=rounding,
            skin=changes(tof_fast=_SKIN),
        )
    if "tof_taps" not in names:
        return Ablations(no_rounding=rounding)
    return Ablations(
        white=changes(tof_light=straight, tof_floor=_OFF, **white),
        no_filters=changes(tof_bilateral=_OFF, tof_edge=_OFF),
        no_rounding=rounding,
        no_light_noise=changes(
            tof_taps={"read_variance": 0.0, "shot_variance": 0.0, "companding": 0.0}
        ),
        skin=changes(tof_light=_SKIN),
        phases=("phasor_a", "phasor_b"),
    )
