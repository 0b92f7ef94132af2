"""Which parts of a sensor's chain can be switched off for a check, and how.

Everything goes by the names of shipped stages, so that a user's sensor made of them has the same
knobs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from glsim.sensor import Sensor
from glsim.validate.bench import Changes

_OFF = {"enabled": 0.0}
_SKIN = {"subsurface_mm": 7.0}


@dataclass(frozen=True)
class Knobs:
    """Changes to a chain; None where it has no such part.

    white: leaves the noise of the phases alone (no floor, no fixed pattern, no rounding).
    no_filters: leaves the decoder's thresholds but none of its filters. no_rounding: depth stays
    a real number. no_light_noise: taps measure light exactly. skin: the delay of light within
    skin. phases: layers that hold the phasors, real and imaginary part of 80 and 16 MHz and of
    120 MHz.
    """

    white: Changes | None = None
    no_filters: Changes | None = None
    no_rounding: Changes | None = None
    no_light_noise: Changes | None = None
    skin: Changes | None = None
    phases: tuple[str, ...] = ()


def knobs_of(sensor: Sensor) -> Knobs:
    """What the stages of a sensor allow."""
    names = {stage.spec.name: stage.name for stage in sensor.stages}

    def changes(**by_spec: Mapping[str, float]) -> Changes | None:
        """Those to stages that the sensor has; None if it has none of them."""
        found = {names[spec]: dict(values) for spec, values in by_spec.items() if spec in names}
        return found or None

    rounding = changes(millimetre_quantise=_OFF)
    straight = {"harmonic_2": 0.0, "harmonic_5": 0.0}
    white = {"fixed_pattern": _OFF, "millimetre_quantise": _OFF}
    if "tof_fast" in names:
        return Knobs(
            white=changes(tof_fast={**straight, "sigma_mm": 0.0, "lateral_px": 0.0}, **white),
            no_rounding=rounding,
            skin=changes(tof_fast=_SKIN),
        )
    if "tof_taps" not in names:
        return Knobs(no_rounding=rounding)
    return Knobs(
        white=changes(tof_light=straight, tof_floor=_OFF, **white),
        no_filters=changes(tof_bilateral=_OFF, tof_edge=_OFF),
        no_rounding=rounding,
        no_light_noise=changes(
            tof_taps={"read_variance": 0.0, "shot_variance": 0.0, "companding": 0.0}
        ),
        skin=changes(tof_light=_SKIN),
        phases=("phasor_a", "phasor_b"),
    )
