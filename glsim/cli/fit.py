"""``glsim fit``: fit a sensor to a recording of a real camera."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from glsim.cli.common import Debug, Quiet, Verbose, options, print_written
from glsim.errors import ConfigError

if TYPE_CHECKING:
    from glsim.fit import NoiseModel, RecordingStatistics
    from glsim.geometry.camera import Intrinsics

EXAMPLES = """
[bold]Examples[/bold]

glsim fit recording/

glsim fit recording/ -o my_kinect.toml --albedo 0.8

glsim fit frames/*.png -o my_camera.toml --focal-px 575.8 --centre-px 320,240
"""


def fit(
    frames: Annotated[
        list[Path], typer.Argument(help="A folder of 16-bit depth PNGs, or the PNGs.")
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="The sensor file to write.")] = Path(
        "sensor.toml"
    ),
    focal_px: Annotated[
        float | None, typer.Option(min=1, help="Focal length, pixels. Default: the base sensor's.")
    ] = None,
    centre_px: Annotated[
        str | None,
        typer.Option(
            help="Principal point x,y, pixels. Default: the base sensor's, or the image centre."
        ),
    ] = None,
    albedo: Annotated[
        float, typer.Option(min=0.01, max=2, help="Albedo of the scene relative to a white wall.")
    ] = 1.0,
    depth_unit_mm: Annotated[float, typer.Option(help="Step of the depth files, mm.")] = 1.0,
    base: Annotated[
        str | None, typer.Option(help="Base sensor: kinect-v2-fast (default) or kinect-v2.")
    ] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Measure a camera's noise on a recording of a static scene and write a sensor file.

    Record at least 30 frames of walls and furniture at many distances; nothing may move. The fit
    uses distances, not brightness, and assumes that all surfaces have the albedo --albedo.
    """
    from glsim.files.atomic import write_atomic
    from glsim.fit import (
        base_sensor,
        fit_noise_model,
        fitted_values,
        measure_recording,
        read_recording,
        sensor_toml,
    )
    from glsim.sensors.sensor import load_sensor

    if out.suffix.lower() != ".toml":
        raise ConfigError(f"-o {out}: give a name that ends in .toml")
    name, tree = base_sensor(base)
    recording = read_recording(frames, depth_unit_mm)
    shape = (recording.depth.shape[1], recording.depth.shape[2])
    image = _camera(tree["rig"], shape, focal_px, centre_px)
    statistics = measure_recording(recording, image)
    emitter = load_sensor(name).rig.emitter_m
    model = fit_noise_model(statistics, image, albedo, depth_unit_mm, _vignetting(tree), emitter)
    values = fitted_values(statistics, model)
    comments = [
        f"Fitted by glsim fit to {len(recording.depth)} frames of {shape[1]}x{shape[0]}: "
        f"{recording.where}",
        *(f"{name}: {text}" for name, text in _result_lines(statistics, model)),
        f"All other values are those of {name}.",
    ]
    write_atomic(sensor_toml(name, tree, values, image, comments).encode(), out)
    if not options.quiet:
        _print(statistics, model)
    print_written([out])


def _camera(
    rig: dict[str, object], shape: tuple[int, int], focal_px: float | None, centre_px: str | None
) -> Intrinsics:
    """Choose the intrinsics: from options, else the base sensor's if the frames have its size."""
    from glsim.cli.common import two_numbers
    from glsim.geometry.camera import Intrinsics

    height, width = shape
    same = (width, height) == (rig["width"], rig["height"])
    if focal_px is None and not same:
        raise ConfigError(
            f"the frames are {width}x{height}, the base sensor's {rig['width']}x{rig['height']}: "
            "give --focal-px"
        )
    focal: list[float] = [focal_px, focal_px] if focal_px is not None else rig["focal_px"]  # type: ignore[assignment]
    centre: list[float] | tuple[float, float]
    if centre_px is not None:
        centre = two_numbers("--centre-px", centre_px)
    else:
        centre = rig["centre_px"] if same else [width / 2, height / 2]  # type: ignore[assignment]
    return Intrinsics(width, height, *focal, *centre)


def _vignetting(tree: dict[str, list[dict[str, float]]]) -> float:
    """Return the power of the cosine by which the base sensor's image darkens."""
    from glsim.noise.registry import find_stage

    for stage in tree["stage"]:
        parameter = find_stage(str(stage["use"])).parameters.get("vignetting")
        if parameter is not None:
            return float(stage.get("vignetting", parameter.default))
    return 0.0


def _result_lines(statistics: RecordingStatistics, model: NoiseModel) -> list[tuple[str, str]]:
    """Describe the results as (name, text)."""
    amplitude = f"{model.amplitude:.0f} +- {max(1.0, 100 * model.amplitude_error):.0f} %"
    lines = [
        ("amplitude of a white wall at 1 m", amplitude if model.knows_amplitude else
         "not determined by this recording (add far or dark walls): the base sensor's is kept"),
        ("floor of the temporal noise", f"{model.floor_mm:.2f} mm"),
        ("fixed pattern",
         f"{statistics.pattern_mm:.2f} mm (pixels {statistics.pixel_mm:.2f}, columns "
         f"{statistics.column_mm:.2f}, step between rows {statistics.row_step_mm:.2f})"),
        ("correlation of the noise at 1 to 4 px",
         ", ".join(f"{c:.2f}" for c in statistics.correlation[1:])),
    ]  # fmt: skip
    if math.isfinite(statistics.invalid_share):
        lines.append((
            f"pixels beside depth edges ({statistics.edge_pixels} per frame)",
            f"{100 * statistics.invalid_share:.0f} % without depth, "
            f"{100 * statistics.flying_share:.1f} % between the surfaces",
        ))  # fmt: skip
    return lines


def _print(statistics: RecordingStatistics, model: NoiseModel) -> None:
    out = Console(highlight=False)
    for name, text in _result_lines(statistics, model):
        out.print(f"{name}: {text}", soft_wrap=True)
    radii = sorted({cell.radius_px for cell in statistics.table})
    names = (f"{a:.0f} to {b:.0f} px" if b < 1000 else f"beyond {a:.0f} px" for a, b in radii)
    table = Table(box=None)
    for name in ("temporal sigma, mm", *names):
        table.add_column(name, no_wrap=True)
    for distance in sorted({cell.distance_m for cell in statistics.table}):
        sigma = {c.radius_px: c.sigma_mm for c in statistics.table if c.distance_m == distance}
        cells = (f"{sigma[r]:.2f}" if r in sigma else "" for r in radii)
        table.add_row(f"{distance[0]:g} to {distance[1]:g} m", *cells)
    out.print(table)
