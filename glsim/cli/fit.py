"""``glsim fit``: fit a sensor to a recording of a real camera."""

from __future__ import annotations

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
    from glsim.bench.fit.fitted_sensor import FittedSensor
    from glsim.measures.depth_noise import Cell

EXAMPLES = """
glsim fit recording/
glsim fit frames/*.png -o my_camera.toml --focal-px 575.8 --albedo 0.8
glsim fit recording.bag -o my_d435.toml             stereo: recognised by its depths
"""


def fit(
    frames: list[Path],
    out: Annotated[Path, typer.Option("-o", "--out")] = Path("sensor.toml"),
    focal_px: Annotated[float | None, typer.Option(min=1)] = None,
    albedo: Annotated[float, typer.Option(min=0.01, max=2)] = 1.0,
    depth_unit_mm: float | None = None,
    base: str | None = None,
    topic: str | None = None,
    as_json: JsonOption = False,
) -> None:
    """Measure a camera's noise on a recording of a static scene and write a sensor file.

    Record at least 30 frames of walls and furniture at many distances; nothing may move. Without
    infrared the fit uses distances, and assumes that all surfaces have the albedo --albedo; with
    infrared, it assumes that the brightest surfaces have it. Wiggling needs undistorted frames of
    plane walls that cover 0.65 m of distances or more: one at a slant, or several at several
    distances. A plain wall shows the fixed pattern, which is also written as a map:
    NAME_fixed_pattern.npy, float32 mm, (rows, columns), NaN where it is unknown. The sensor file
    names the map, and frames of that sensor have this pattern.

    Recordings of stereo and structured light are recognised by their depths (the lattice of f B /
    n). For these, the fit finds focal length times baseline, the temporal and the static noise of
    disparity, its correlation and holes, and writes a sensor that extends the nearest shipped one.

    Args:
        frames: A recording as glsim import kinect2 reads it, a data set, or files.
        out: The sensor file to write.
        focal_px: Focal length, pixels. Default: stated, or the base sensor's.
        albedo: Albedo of the scene relative to a white wall.
        depth_unit_mm: Step of the depth files, mm. Default: the stated step, or 1.
        base: Base sensor: kinect-v2-fast, kinect-v2, or one that matches images. Default:
            recognised by the recording's depths.
        topic: Topic of the depth images in a bag. Default: native images named depth.
    """
    import io

    import numpy as np

    from glsim.bench.fit.stereo_sensor import fit_stereo, stereo_base
    from glsim.bench.fit.time_of_flight import fit_time_of_flight
    from glsim.core.files.atomic import write_atomic
    from glsim.data.maps import open_maps

    if out.suffix.lower() != ".toml":
        raise ConfigError(f"-o {out}: give a name that ends in .toml")
    check_outputs(out)
    recording = open_maps(frames, unit_mm=depth_unit_mm, topic=topic)
    map_file = out.with_name(f"{out.stem}_fixed_pattern.npy")
    if (matching := stereo_base(recording, base)) is not None:
        fitted = fit_stereo(recording, matching, focal_px)
    else:
        fitted = fit_time_of_flight(recording, base, albedo, focal_px, map_file.name)
    written = [out]
    if fitted.map_mm is not None:
        picture = io.BytesIO()
        np.save(picture, fitted.map_mm)
        write_atomic(picture.getvalue(), map_file)
        written.append(map_file)
    write_atomic(fitted.text.encode(), out)
    if as_json:
        cells = {} if fitted.table is None else {"sigma_mm": _cells(fitted.table)}
        print_json({"sensor": str(out), "results": fitted.lines, **cells})
    elif not options.quiet:
        _print(fitted)
    print_written(written)
    sentence = recording.sentence(focal_px, "the base sensor")
    for note in filter(None, (*fitted.notes, sentence)):
        print_message(note)


def _cells(table: tuple[Cell, ...]) -> list[dict[str, Any]]:
    """Return the table of sigma as JSON values."""
    return [
        {"distance_m": list(cell.distance_m), "radius_px": list(cell.radius_px),
         "sigma_mm": float(cell.value), "pixels": int(cell.pixels)}
        for cell in table
    ]  # fmt: skip


def _print(fitted: FittedSensor) -> None:
    out = make_console()
    for name, text in fitted.lines.items():
        out.print(f"{name}: {text}", soft_wrap=True)
    if fitted.table is None:
        return
    radii = sorted({cell.radius_px for cell in fitted.table})
    table = Table(box=None)
    for name in ("sigma, mm", *(f"{a:.0f}-{b:.0f} px" for a, b in radii)):
        table.add_column(name, no_wrap=True)
    for distance in sorted({cell.distance_m for cell in fitted.table}):
        sigma = {c.radius_px: c.value for c in fitted.table if c.distance_m == distance}
        cells = (f"{sigma[r]:.2f}" if r in sigma else "" for r in radii)
        table.add_row(f"{distance[0]:g} to {distance[1]:g} m", *cells)
    out.print(table)
