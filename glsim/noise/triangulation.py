"""Checks of a sensor that triangulates: its imagers, its projectors and its matcher."""

from __future__ import annotations

from collections.abc import Sequence

from glsim.errors import ConfigError
from glsim.geometry.camera import Distortion, SensorRig
from glsim.noise.stage import ENABLED, Stage

#: The stage that matches two images.
MATCHER = "match_stereo"

#: Largest part of a baseline across its main axis: images are matched along rows or columns.
_LARGEST_SKEW = 1e-3


def check_triangulation(stages: Sequence[Stage], rig: SensorRig, where: str) -> None:
    """Raise ConfigError if the imagers do not fit each other, the lens or the matcher.

    Args:
        where: the sensor file, for messages.
    """
    matches = any(s.spec.name == MATCHER and s.settings[ENABLED].bounds()[1] > 0 for s in stages)
    imagers, emitters = len(rig.imagers_m), len(rig.emitters)
    if matches and (imagers == 0 or imagers + emitters < 2):
        raise ConfigError(
            f"{where}: stage {MATCHER!r} matches two views, but the rig has {imagers} imagers and "
            f"{emitters} emitters: give it a second one under [[rig.imager]], or a projector under "
            "[[rig.emitter]]"
        )
    if not imagers:
        return
    if imagers > 2 or emitters > 2:
        raise ConfigError(
            f"{where}: the rig has {imagers} imagers and {emitters} emitters: two of each at most"
        )
    across, along = sorted(abs(v) for v in rig.second_view_m[:2])
    if imagers + emitters > 1 and (along == 0 or across > _LARGEST_SKEW * along):
        raise ConfigError(
            f"{where}: the second view is at {rig.second_view_m} m from the first: images are "
            "matched along rows or columns, so move it along x or along y alone"
        )
    if rig.second_view_m[2] != 0 or any(z != 0 for _, _, z in rig.imagers_m):
        raise ConfigError(f"{where}: imagers and their projector must have z = 0: rectified images")
    if rig.keeps_distortion or rig.supersample > 1:
        raise ConfigError(
            f'{where}: images are matched after rectification, so deliver = "undistorted" and '
            "supersample = 1"
        )
    if rig.distortion != Distortion():
        raise ConfigError(f"{where}: rectified images have no lens distortion: leave it out")
