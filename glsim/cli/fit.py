"""``glsim fit``: a sensor from a recording of a real camera."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.console import Console
from rich.table import Table

from glsim.cli.common import Debug, Quiet, Verbose, listed, options
from glsim.errors import ConfigError

if TYPE_CHECKING:
    from glsim.camera import Intrinsics
    from glsim.fit import Model, Statistics

EXAMPLES = """
[bold]Examples[/bold]

glsim fit recording/

glsim fit recording/ -o my_kinect.toml --albedo 0.8

glsim fit frames/*.png -o my_camera.toml --focal-px 575.8 --centre-px 320,240
"""


def fit(
    frames: Annotated[list[Path], typer.Argument(help="A folder of 16-bit depth PNGs, or PNGs.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="The sensor file to write.")] = Path(
        "sensor.toml"
    ),
    focal_px: Annotated[
        float | None, typer.Option(min=1, help="Focal length; default: the base sensor's.")
    ] = None,
    centre_px: Annotated[
        str | None, typer.Option(help="Principal point x,y; default: the base's, or the middle.")
    ] = None,
    albedo: Annotated[
        float, typer.Option(min=0.01, max=2, help="Of the scene, relative to a white wall.")
    ] = 1.0,
    depth_unit_mm: Annotated[float, typer.Option(help="Step of the depth files.")] = 1.0,
    base: Annotated[
        str | None, typer.Option(help="What to start from: kinect-v2-fast or kinect-v2.")
    ] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Measure a camera's noise on a recording of a static scene and write a sensor with it.

    Record 30 frames or more of walls and furniture at many distances; nothing may move. Only
    distance, not brightness, is looked at: the amplitude that is found is of walls of --albedo.
    """
    from glsim.dataset.files import write_bytes
    from glsim.fit import (
        base_sensor,
        fit_model,
        fitted_values,
        measure,
        read_recording,
        sensor_text,
    )
    from glsim.sensor import load_sensor

    if out.suffix.lower() != ".toml":
        raise ConfigError(f"-o {out}: give a name that ends in .toml")
    name, tree = base_sensor(base)
    recording = read_recording(frames, depth_unit_mm)
    shape = (recording.depth.shape[1], recording.depth.shape[2])
    image = _camera(tree["rig"], shape, focal_px, centre_px)
    found = measure(recording, image)
    emitter = load_sensor(name).rig.emitter_m
    model = fit_model(found, image, albedo, depth_unit_mm, _vignetting(tree), emitter)
    values = fitted_values(found, model)
    comments = [
        f"Fitted by glsim fit to {found.frames} frames of {shape[1]}x{shape[0]}: {recording.where}",
        *(f"{what}: {number}" for what, number in _facts(found, model)),
        "What is not fitted is as in " + name + ".",
    ]
    write_bytes(sensor_text(name, tree, values, image, comments).encode(), out)
    if not options.quiet:
        _print(found, model)
    listed([out])


def _camera(
    rig: dict[str, object], shape: tuple[int, int], focal_px: float | None, centre_px: str | None
) -> Intrinsics:
    """The pinhole of the recording: as told, else the base's if the frames are of its size."""
    from glsim.camera import Intrinsics
    from glsim.cli.common import two_numbers

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
    """The power of the cosine by which the base sensor's image darkens."""
    from glsim.noise.stage import find

    for stage in tree["stage"]:
        parameter = find(str(stage["use"])).parameters.get("vignetting")
        if parameter is not None:
            return float(stage.get("vignetting", parameter.default))
    return 0.0


def _facts(found: Statistics, model: Model) -> list[tuple[str, str]]:
    """What was found, in words."""
    known = f"{model.amplitude:.0f} +- {max(1.0, 100 * model.amplitude_error):.0f} %"
    facts = [
        ("amplitude of a white wall at 1 m", known if model.knows_amplitude else
         "not told by this recording (add far or dark walls): the base's is kept"),
        ("floor of the temporal noise", f"{model.floor_mm:.2f} mm"),
        ("fixed pattern", f"{found.pattern_mm:.2f} mm (pixels {found.pixel_mm:.2f}, columns "
         f"{found.column_mm:.2f}, step between rows {found.row_step_mm:.2f})"),
        ("correlation of the noise at 1 to 4 px",
         ", ".join(f"{c:.2f}" for c in found.correlation[1:])),
    ]  # fmt: skip
    if math.isfinite(found.invalid_share):
        facts.append((
            f"pixels beside depth edges ({found.edge_pixels} a frame)",
            f"{100 * found.invalid_share:.0f} % without depth, {100 * found.flying_share:.1f} % "
            "between the surfaces",
        ))  # fmt: skip
    return facts


def _print(found: Statistics, model: Model) -> None:
    out = Console(highlight=False)
    for what, number in _facts(found, model):
        out.print(f"{what}: {number}", soft_wrap=True)
    radii = sorted({cell.radius_px for cell in found.table})
    names = (f"{a:.0f} to {b:.0f} px" if b < 1000 else f"beyond {a:.0f} px" for a, b in radii)
    table = Table(box=None)
    for name in ("temporal sigma, mm", *names):
        table.add_column(name, no_wrap=True)
    for distance in sorted({cell.distance_m for cell in found.table}):
        sigma = {c.radius_px: c.sigma_mm for c in found.table if c.distance_m == distance}
        cells = (f"{sigma[r]:.2f}" if r in sigma else "" for r in radii)
        table.add_row(f"{distance[0]:g} to {distance[1]:g} m", *cells)
    out.print(table)
