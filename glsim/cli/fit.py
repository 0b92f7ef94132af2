"""``glsim fit``: fit a sensor to a recording of a real camera."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from glsim.cli.common import (
    JsonOption,
    check_outputs,
    make_console,
    options,
    print_json,
    print_message,
    print_written,
)
from glsim.core.errors import ConfigError

if TYPE_CHECKING:
    from glsim.bench.fit.noise_model import InfraredLaw, NoiseModel
    from glsim.bench.fit.recording_statistics import RecordingStatistics
    from glsim.bench.fit.smoothing import Smoothing
    from glsim.bench.fit.wiggling import Wiggling
    from glsim.core.camera import Intrinsics

EXAMPLES = """
[bold]Examples[/bold]

glsim fit recording/

glsim fit frames/*.png -o my_camera.toml --focal-px 575.8 --albedo 0.8

glsim fit recording.bag -o my_d435.toml             stereo: recognised by its depths
"""


def fit(
    frames: Annotated[
        list[Path],
        typer.Argument(help="A recording as glsim import kinect2 reads it, a data set, or files."),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="The sensor file to write.")] = Path(
        "sensor.toml"
    ),
    focal_px: Annotated[
        float | None,
        typer.Option(min=1, help="Focal length, pixels. Default: stated, or the base sensor's."),
    ] = None,
    albedo: Annotated[
        float, typer.Option(min=0.01, max=2, help="Albedo of the scene relative to a white wall.")
    ] = 1.0,
    depth_unit_mm: Annotated[
        float | None,
        typer.Option(help="Step of the depth files, mm. Default: as the recording says, or 1."),
    ] = None,
    base: Annotated[
        str | None,
        typer.Option(
            help="Base sensor: kinect-v2-fast, kinect-v2, or one that matches images. Default: "
            "what the recording's depths say."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Measure a camera's noise on a recording of a static scene and write a sensor file.

    Record at least 30 frames of walls and furniture at many distances; nothing may move. Without
    infrared the fit uses distances, and assumes that all surfaces have the albedo --albedo; with
    infrared, that the brightest ones have it. Wiggling needs undistorted frames of plane walls that
    cover 0.65 m of distances or more: one at a slant, or several at several distances. A plain wall
    shows the fixed pattern, which is also written as a map: NAME_fixed_pattern.npy, float32 mm,
    (rows, columns), NaN where it is unknown. The sensor file names the map, and frames of that
    sensor have this pattern.

    Recordings of stereo and structured light are told by their depths (the lattice of f B / n): the
    fit finds focal length times baseline, the noise of disparity from frame to frame and what stays
    of it, its correlation, holes, and writes a sensor that extends the nearest shipped one.
    """
    import io

    import numpy as np

    from glsim.bench.fit.noise_model import fit_infrared, fit_noise_model
    from glsim.bench.fit.recording_statistics import measure_recording
    from glsim.bench.fit.sensor_file import (
        base_profile,
        base_sensor,
        base_taps,
        fitted_values,
        knows_pattern,
        sensor_toml,
        unplaced_parameters,
    )
    from glsim.bench.fit.smoothing import (
        find_smoothing,
        has_filter,
        smoothed_values,
        with_smoothing,
    )
    from glsim.bench.fit.wiggling import fit_wiggling
    from glsim.cli.fit_stereo import fit_stereo_recording, stereo_base
    from glsim.core.depth_frame import Frames
    from glsim.core.files.atomic import write_atomic
    from glsim.data.recordings.recording import open_recording
    from glsim.sensors.sensor import load_sensor

    if out.suffix.lower() != ".toml":
        raise ConfigError(f"-o {out}: give a name that ends in .toml")
    check_outputs(out)
    recording = open_recording(frames, depth_unit_mm)
    if (matching := stereo_base(recording, base)) is not None:
        fit_stereo_recording(recording, matching, out, focal_px, as_json=as_json)
        return
    name, tree = base_sensor(base)
    recorded = recording.read_static()
    image = _camera(
        load_sensor(name).rig.intrinsics, recording.camera, recorded.intrinsics, focal_px
    )
    recorded = Frames.of([frame.changed(intrinsics=image) for frame in recorded], recorded.title)
    statistics = measure_recording(recorded)
    smoothing = find_smoothing(statistics.correlation)
    if smoothing is not None and base is None:
        name, tree = base_sensor("kinect-v2")  # its filter can be exchanged
    wide = smoothing is not None and has_filter(tree)
    emitter, taps = load_sensor(name).rig.emitter_m, base_taps(tree)
    unit_mm = recorded[0].step_mm
    model = fit_noise_model(statistics, image, albedo, unit_mm, base_profile(tree), emitter, taps)
    law = None
    if recorded[0].infrared is not None:
        law = fit_infrared(statistics, recorded, albedo, taps)
    wiggling = fit_wiggling(statistics, image, emitter)
    values = fitted_values(statistics, model, law, taps, wiggling)
    if smoothing is not None and wide:
        own = {"read_lsb2": taps.read_lsb2, "shot_lsb": taps.shot_lsb}
        sigma_mm = float(np.sqrt(np.nanmedian(statistics.variance_mm2[statistics.smooth])))
        values = smoothed_values(values, smoothing, own, sigma_mm)
        tree = with_smoothing(tree, smoothing)
    lines = _result_lines(statistics, model, law, wiggling)
    if smoothing is not None:
        lines.append(("filter of the correlated noise", _smoothing_text(smoothing, wide)))
    map_file = out.with_name(f"{out.stem}_fixed_pattern.npy")
    missing = unplaced_parameters(tree, values)
    usable_map = knows_pattern(statistics)
    comments = [
        f"Fitted by glsim fit to {statistics.frames} frames of {image.width}x{image.height}: "
        f"{recording.path}",
        *(f"{title}: {text}" for title, text in lines),
        f"Map of this device's own fixed pattern: {map_file.name} (float32 mm, NaN = unknown"
        + (")." if usable_map else "); too noisy to add to frames."),
        f"All other values are those of {name}.",
    ]
    picture = io.BytesIO()
    np.save(picture, statistics.pattern.map_mm)
    waves = wiggling.waves() if wiggling is not None else ()
    named = map_file.name if usable_map else ""
    text = sensor_toml(name, tree, values, image, comments, named, waves)
    write_atomic(picture.getvalue(), map_file)
    write_atomic(text.encode(), out)
    if as_json:
        print_json({"sensor": str(out), "results": dict(lines), "sigma_mm": _cells(statistics)})
    elif not options.quiet:
        _print(statistics, lines)
    if missing:
        print_message(f"{name} has no parameter for {', '.join(missing)}: not written")
    print_written([out, map_file])


def _camera(
    own: Intrinsics, stated: Intrinsics | None, frames: Intrinsics, focal_px: float | None
) -> Intrinsics:
    """Choose the intrinsics: with ``focal_px``, else the recording's, else the base sensor's."""
    from glsim.core.camera import Intrinsics

    size = width, height = frames.width, frames.height
    known = [k for k in (stated, own) if k is not None and (k.width, k.height) == size]
    if known:
        focal = (focal_px or known[0].fx, focal_px or known[0].fy)
        return Intrinsics(*size, *focal, known[0].cx, known[0].cy)
    if focal_px is None:
        raise ConfigError(
            f"the frames are {width}x{height}, the base sensor's {own.width}x{own.height}: "
            "give --focal-px"
        )
    return Intrinsics(*size, focal_px, focal_px, width / 2, height / 2)


def _result_lines(
    statistics: RecordingStatistics,
    model: NoiseModel,
    law: InfraredLaw | None,
    wiggling: Wiggling | None,
) -> list[tuple[str, str]]:
    """Describe the results as (name, text)."""
    pattern = statistics.pattern
    lines = [*_light_lines(model, law)]
    lines += [
        ("fixed pattern",
         f"{pattern.total_mm:.2f} mm (alternation of rows {abs(pattern.alternation_mm):.2f}, rows "
         f"{pattern.row_mm:.2f}, columns {pattern.column_mm:.2f}, pixels {pattern.pixel_mm:.2f}, "
         f"these alike at 1 px by {pattern.pixel_correlation:.2f})"),
        ("map of the fixed pattern", _map_text(statistics)),
        ("correlation of the noise at 1 to 3 px along rows; diagonal",
         ", ".join(f"{c:.2f}" for c in statistics.correlation[:3])
         + f"; {statistics.correlation[-1]:.2f}"),
        ("wiggling", _wiggling_text(wiggling)),
    ]  # fmt: skip
    if math.isfinite(statistics.invalid_share):
        lines.append((
            f"pixels beside depth edges ({statistics.edge_pixels} per frame)",
            f"{100 * statistics.invalid_share:.0f} % without depth, "
            f"{100 * statistics.flying_share:.1f} % between the surfaces",
        ))  # fmt: skip
    return lines


def _light_lines(model: NoiseModel, law: InfraredLaw | None) -> list[tuple[str, str]]:
    """Describe light and noise: from infrared if there is any, else from the distances."""
    unknown = "not determined by this recording (add far or dark walls): the base sensor's is kept"
    amplitude = f"{model.amplitude:.0f} +- {max(1.0, 100 * model.amplitude_error):.0f} %"
    if law is None or not math.isfinite(law.gain):
        return [
            ("amplitude of a white wall at 1 m", amplitude if model.knows_amplitude else unknown),
            ("floor of the temporal noise", f"{model.floor_mm:.2f} mm"),
        ]
    lines = [
        ("amplitude of a white wall at 1 m", f"{law.gain:.0f} (infrared {16 * law.gain:.0f})"),
    ]
    if not law.knows_noise:
        return [*lines, ("noise over infrared", unknown)]
    own = law.law
    noise = f"sigma^2 = {own.floor_mm:.2f}^2 + ({own.slope_mm:.0f} / infrared)^2 mm^2"
    return [
        *lines,
        ("noise over infrared", noise),
        ("floor beside the noise of taps", f"{law.floor_mm:.2f} mm"),
    ]


def _map_text(statistics: RecordingStatistics) -> str:
    from glsim.bench.fit.sensor_file import LEAST_PATTERN_FRAMES, knows_pattern

    text = f"{100 * statistics.pattern.known_share:.0f} % of the pixels, those on flat surfaces"
    if not knows_pattern(statistics):
        text += (
            f"; mostly temporal noise with {statistics.frames} frames: below "
            f"{LEAST_PATTERN_FRAMES} the part of single pixels is not fitted, "
            "and the sensor does not name the map"
        )
    return text


def _smoothing_text(smoothing: Smoothing, wide: bool) -> str:
    if not wide:
        return "beyond 3x3 px, which this base cannot have: give --base kinect-v2"
    numbers = ", ".join(f"{c:.2f}" for c in smoothing.correlation[:3])
    return (
        f"Gaussian over 7x7 px, {smoothing.width_px:.1f} px (tof_smooth): {numbers} at 1 to 3 px "
        "along rows"
    )


def _wiggling_text(wiggling: Wiggling | None) -> str:
    if wiggling is None:
        return "not determined by this recording (add walls, one at a slant: 0.65 m of distances)"
    parts = []
    for harmonic, amplitude in wiggling.amplitude.items():
        phases = " and ".join(f"{math.degrees(p):.0f}" for p in wiggling.phase_rad[harmonic])
        parts.append(
            f"harmonic {harmonic}: {amplitude:.4f} +- {wiggling.error[harmonic]:.4f}, "
            + (f"{phases} deg at 80 and 120 MHz" if wiggling.known(harmonic) else "not significant")
        )
    return "; ".join(parts)


def _cells(statistics: RecordingStatistics) -> list[dict[str, Any]]:
    """Return the table of sigma as JSON values."""
    return [
        {"distance_m": list(cell.distance_m), "radius_px": list(cell.radius_px),
         "sigma_mm": float(cell.value), "pixels": int(cell.pixels)}
        for cell in statistics.table
    ]  # fmt: skip


def _print(statistics: RecordingStatistics, lines: list[tuple[str, str]]) -> None:
    out = make_console()
    for name, text in lines:
        out.print(f"{name}: {text}", soft_wrap=True)
    radii = sorted({cell.radius_px for cell in statistics.table})
    table = Table(box=None)
    for name in ("sigma, mm", *(f"{a:.0f}-{b:.0f} px" for a, b in radii)):
        table.add_column(name, no_wrap=True)
    for distance in sorted({cell.distance_m for cell in statistics.table}):
        sigma = {c.radius_px: c.value for c in statistics.table if c.distance_m == distance}
        cells = (f"{sigma[r]:.2f}" if r in sigma else "" for r in radii)
        table.add_row(f"{distance[0]:g} to {distance[1]:g} m", *cells)
    out.print(table)
