"""The part of ``glsim fit`` for cameras that match images: stereo and structured light."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from glsim.cli.common import (
    make_console,
    options,
    print_json,
    print_message,
    print_written,
)
from glsim.core.errors import ConfigError

if TYPE_CHECKING:
    from glsim.bench.fit.stereo_sensor import StereoFit
    from glsim.bench.fit.stereo_statistics import StereoStatistics
    from glsim.core.camera import Intrinsics
    from glsim.data.recordings.recording import Recording
    from glsim.sensors.sensor import Sensor

#: Bases of recordings whose depths lie on a lattice: by size, and for other sizes.
_VGA, _ANY_STEREO = {(640, 480): "realsense-d435-vga"}, "realsense-d435"
#: Frames whose depths say whether there is a lattice. Chosen: more say nothing new.
_FRAMES = 12


def stereo_base(recording: Recording, base: str | None) -> str | None:
    """Return the sensor that a fit extends; None for a camera that measures times of flight.

    Args:
        recording: whose depths say what made it.
        base: sensor that the user names; it decides.

    Raises:
        ConfigError: the named sensor does not match images.
    """
    from glsim.bench.fit.sensor_file import BASES
    from glsim.bench.fit.stereo_sensor import check_base, matches_images
    from glsim.bench.fit.stereo_statistics import find_lattice

    if base is not None:
        if base in BASES:
            return None
        check_base(base)
        return base
    stated = recording.stated.sensor
    if stated and matches_images(stated):
        return stated
    frames = recording.read(_FRAMES)
    height, width = frames[0].measured_mm.shape
    return _VGA.get((width, height), _ANY_STEREO) if find_lattice(frames) is not None else None


def fit_stereo_recording(
    recording: Recording,
    base: str,
    out: Path,
    focal_px: float | None,
    *,
    as_json: bool = False,
) -> None:
    """Fit a sensor that matches images to a static recording, print what was measured, write it.

    Args:
        recording: at least two frames of one view.
        base: sensor that the file extends.
        out: the sensor file.
        focal_px: of the recording; None: as stated, the base's, or by its baseline.
        as_json: print JSON.

    Raises:
        ConfigError: an option is wrong.
        DatasetError: the recording is not static, or shows no planes.
    """
    from glsim.bench.fit.stereo_sensor import check_base, fit_stereo, matcher_value, stereo_toml
    from glsim.bench.fit.stereo_statistics import FRAMES, find_lattice, measure_stereo
    from glsim.core.files.atomic import write_atomic
    from glsim.gl.context import open_context

    sensor = check_base(base)
    frames = recording.read(FRAMES)
    product = 1000.0 * sensor.rig.intrinsics.fx * sensor.rig.baseline_m
    steps = matcher_value(sensor, "subpixel_steps")
    statistics = measure_stereo(frames, find_lattice(frames), steps, product)
    image = _camera(recording, sensor, statistics, focal_px)
    named = str(Path(base).resolve()) if base.endswith(".toml") else base
    context = open_context(None)
    try:
        fitted = fit_stereo(statistics, named, image, context)
    finally:
        context.release()
    lines = _result_lines(statistics, fitted)
    comments = [
        f"Fitted by glsim fit to {statistics.frames} frames of "
        f"{image.width}x{image.height}: {recording.path}",
        *(f"{name}: {text}" for name, text in lines),
        f"All other values are those of {sensor.name}.",
    ]
    write_atomic(stereo_toml(fitted, sensor, comments).encode(), out)
    if as_json:
        print_json({"sensor": str(out), "results": dict(lines)})
    elif not options.quiet:
        console = make_console()
        for name, text in lines:
            console.print(f"{name}: {text}", soft_wrap=True)
    for note in (*recording.notes, *fitted.notes):
        print_message(note)
    print_written([out])


def _camera(
    recording: Recording,
    sensor: Sensor,
    statistics: StereoStatistics,
    focal_px: float | None,
) -> Intrinsics:
    """Choose the intrinsics: of options, the recording, the base sensor, or its baseline."""
    from glsim.core.camera import Intrinsics

    size = width, height = statistics.size
    own, stated = sensor.rig.intrinsics, recording.camera
    focal = (statistics.focal_baseline_px_mm / sensor.rig.baseline_m / 1000.0,) * 2
    centre = width / 2, height / 2
    for known in (own, stated):
        if known is not None and (known.width, known.height) == size:
            focal, centre = (known.fx, known.fy), (known.cx, known.cy)
    if focal_px is not None:
        focal = focal_px, focal_px
    if min(focal) < 1:
        raise ConfigError(f"the focal length would be {min(focal):.3g} px: give --focal-px")
    return Intrinsics(width, height, *focal, *centre)


def _result_lines(statistics: StereoStatistics, fitted: StereoFit) -> list[tuple[str, str]]:
    """Describe the results as (name, text): of the recording, and of the fitted sensor."""
    real, own = statistics.noise, fitted.noise
    lattice = statistics.lattice
    by = "the base sensor's: the depths are on no lattice that says it"
    if lattice is not None:
        by = f"depths are round({lattice.constant:,.0f} / n) units"
    places = ", ".join(f"{z / 1000:.2f}" for z in statistics.distances_mm)

    def correlations(values: tuple[float, ...]) -> str:
        return ", ".join(f"{value:.2f}" for value in values[:6])

    def pair(name: str) -> str:
        return f"{getattr(real, name):.3f} px (fitted sensor: {getattr(own, name):.3f})"

    return [
        ("base", fitted.base),
        ("focal length times baseline",
         f"{statistics.focal_baseline_px_mm:,.0f} px mm ({by}); baseline "
         f"{1000 * fitted.baseline_m:.2f} mm at {fitted.image.fx:.1f} px"),
        ("planes compared at", f"{places} m"),
        ("noise from frame to frame", pair("frame")),
        ("share that stays", pair("static")),
        ("residual of planes", pair("residual")),
        ("correlation in time at 1, 2, 3, 4, 6, 8 px along rows",
         f"{correlations(real.frame_rows)} (fitted sensor: {correlations(own.frame_rows)})"),
        ("the same along columns",
         f"{correlations(real.frame_columns)} (fitted sensor: {correlations(own.frame_columns)})"),
        ("holes right of the left band", f"{100 * statistics.holes:.1f} %"),
        ("pixels with depth in one of two frames only", f"{100 * statistics.flips:.1f} %"),
    ]  # fmt: skip
