"""Which parts of a sensor's chain can be switched off for a check, and how.

Everything goes by the names of shipped stages, so that a user's sensor made of them has the same
knobs.
"""

from __future__ import annotations

from dataclasses import dataclass

from glsim.sensor import Sensor
from glsim.validate.bench import Changes

_OFF = {"enabled": 0.0}


@dataclass(frozen=True)
class Knobs:
    """Changes to a chain; None where it has no such part.

    white: leaves the noise of the phases alone (no floor, no fixed pattern, no rounding).
    no_filters: leaves the decoder's thresholds but none of its filters. no_rounding: depth stays
    a real number. skin: the delay of light within skin.
    """

    white: Changes | None = None
    no_filters: Changes | None = None
    no_rounding: Changes | None = None
    skin: Changes | None = None


def knobs_of(sensor: Sensor) -> Knobs:
    """What the stages of a sensor allow."""
    names = {stage.spec.name: stage.name for stage in sensor.stages}
    rounding = names.get("millimetre_quantise")
    return Knobs(no_rounding=None if rounding is None else {rounding: _OFF})
