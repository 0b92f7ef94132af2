"""Check that the stages of a sensor fit its rig: modulation, emitters, imagers and matcher."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import gcd

from glsim.core.camera import Distortion, SensorRig
from glsim.core.errors import ConfigError
from glsim.noise.stage import ENABLED, Stage

#: Speed of light, m/s, as rounded in the Kinect V2's decoder, whose tables hold half wavelengths of
#: 1875, 9375 and 1250 mm (libfreenect2: unambigious_dist 2083.333 mm = c / 2 / 72 MHz). The depth
#: is right for any value, because encoder and decoder use the same one.
SPEED_OF_LIGHT = 3.0e8
#: Stages that do nothing for a rig without an emitter.
_SHADOW_STAGES = ("shadow", "tof_shadow")
#: Frequencies are rounded to multiples of this step, MHz, to find their common period.
_GRID_MHZ = Fraction(1, 1000)


def check_rig(stages: Sequence[Stage], rig: SensorRig, where: str) -> None:
    """Raise ConfigError if a stage needs light, emitters or imagers that the rig does not have."""
    for stage in stages:
        if {"near_mm", "far_mm"} <= stage.settings.keys():
            near, far = stage.settings["near_mm"].bounds()[1], stage.settings["far_mm"].bounds()[0]
            if near >= far:
                raise ConfigError(
                    f"{where}: {stage.name}.near_mm {near:g} must be less than "
                    f"{stage.name}.far_mm {far:g}"
                )
        timed = stage.spec.source is not None and "u_modulation_mhz" in stage.spec.source.bound
        shaded = stage.spec.name in _SHADOW_STAGES and stage.settings[ENABLED].bounds()[1] > 0
        if (timed or shaded) and not rig.emitters:
            raise ConfigError(
                f"{where}: stage {stage.name!r} measures the emitter's light or its shadows, but "
                "the rig has no emitter: give it one under [[rig.emitter]]"
            )
        if timed:
            _check_frequencies(rig.modulation_mhz, rig.far_m, where)
    _check_triangulation(stages, rig, where)


def _check_frequencies(modulation_mhz: Sequence[float], far_m: float, where: str) -> None:
    given = f"{where}: rig.modulation_mhz {[float(f) for f in modulation_mhz]}"
    if len(modulation_mhz) != 3 or min(modulation_mhz) < 1:
        raise ConfigError(f"{given}: give three frequencies above 1 MHz, e.g. [80, 16, 120]")
    fast, slow, other = whole = [round(Fraction(mhz) / _GRID_MHZ) for mhz in modulation_mhz]
    if fast % slow or fast == slow:
        raise ConfigError(
            f"{given}: cannot be unwrapped: the first must be a whole multiple of the second"
        )
    reach = SPEED_OF_LIGHT / 2e6 / float(gcd(*whole) * _GRID_MHZ)  # then all phases repeat
    if reach < far_m:
        raise ConfigError(
            f"{given}: cannot be unwrapped: the phases repeat after {reach:.2f} m, "
            f"nearer than rig.far_m {far_m:g}"
        )
    # The slow phase repeats this many times before all phases repeat together; the third phase must
    # differ between these repeats.
    repeats = slow // gcd(fast, slow, other)
    turns = Fraction(other, slow)
    if len({(turns * n) % 1 for n in range(repeats)}) < repeats:
        raise ConfigError(f"{given}: cannot be unwrapped: the third does not tell slow turns apart")


#: The name of the stage that matches two images.
MATCHER = "match_stereo"
#: Largest share of a baseline across its main axis: images are matched along rows or columns.
_LARGEST_SKEW = 1e-3


def _check_triangulation(stages: Sequence[Stage], rig: SensorRig, where: str) -> None:
    """Raise ConfigError if the imagers do not fit each other, the lens or the matcher."""
    matches = any(s.spec.name == MATCHER and s.settings[ENABLED].bounds()[1] > 0 for s in stages)
    imagers, emitters = len(rig.imagers_m), len(rig.emitters)
    if matches and (imagers == 0 or imagers + emitters < 2):
        raise ConfigError(
            f"{where}: stage {MATCHER!r} matches two views, but the rig has {imagers} imagers and "
            f"{emitters} emitters: give it a second [[rig.imager]], or a projector, [[rig.emitter]]"
        )
    if not imagers:
        return
    across, along = sorted(abs(v) for v in rig.second_view_m[:2])
    problem = ""
    if imagers > 2 or emitters > 2:
        problem = f"{imagers} imagers and {emitters} emitters: two of each at most"
    elif imagers + emitters > 1 and (along == 0 or across > _LARGEST_SKEW * along):
        problem = (
            f"its second view at {rig.second_view_m} m from the first: images are matched along "
            "rows or columns, so move it along x or along y alone"
        )
    elif any(z != 0 for _, _, z in (rig.second_view_m, *rig.imagers_m)):
        problem = "an imager or a projector away from z = 0: rectified images need z = 0"
    elif rig.keeps_distortion or rig.supersample > 1 or rig.distortion != Distortion():
        problem = (
            'imagers, whose images are rectified: deliver = "undistorted", supersample = 1, and no '
            "lens distortion"
        )
    if problem:
        raise ConfigError(f"{where}: the rig has {problem}")
