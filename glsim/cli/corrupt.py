"""``glsim corrupt``: add sensor noise to existing depth maps."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from glsim.cli.common import SensorOption, SetOption, console, overrides, print_message, two_numbers
from glsim.core.errors import ConfigError, DatasetError, counted

if TYPE_CHECKING:
    from glsim.core.depth_frame import DepthFrame
    from glsim.simulation.depth_noise import DepthNoise

#: A map that loses this share of its depth is no map of a surface before the sensor. Chosen.
_MOST_LOST = 0.99


def corrupt(
    clean: Path,
    out: Annotated[Path, typer.Option("-o", "--out")],
    sensor: SensorOption = None,
    assignments: SetOption = None,
    seed: int | None = None,
    depth_unit_mm: float | None = None,
    topic: str | None = None,
    focal_px: str | None = None,
    centre_px: str | None = None,
    config: Path | None = None,
    backend: Literal["egl", "osmesa", "numpy"] | None = None,
    channel: str | None = None,
    along_ray: Annotated[bool, typer.Option("--along-ray")] = False,
) -> None:
    """Add the noise of a sensor to clean depth maps; 0 means no depth, in and out.

    Whole numbers are steps of --depth-unit-mm, floats of .npy, .exr and TIFF are metres, or
    millimetres if the median of a folder says so. What is beyond the sensor's far plane is no
    surface. A folder is read with its sub-folders; every map keeps its name, but NAME_clean becomes
    NAME_noisy. The noise of a map depends on the seed and on its depths, whatever its name and
    format; copies of a map have noise of their own, in the order of their names. Maps that cannot
    be read are reported and skipped. Of a folder that glsim wrote, only the clean depth is taken.
    Noisy PNGs state the sensor, and their step if the clean one does, or if it is not 1 mm; a
    folder gets a camera.toml.

    Args:
        clean: A clean depth map (16-bit PNG or TIFF, .npy, .exr), or a folder of them.
        out: The noisy map, or a folder for them.
        assignments: Set a parameter of the noise, such as tof_floor.sigma_mm=2. Repeatable.
        focal_px: Focal length of the maps, pixels, one number or x,y. Default: as a camera.toml
            says, else the sensor's.
        centre_px: Principal point x,y of the maps, pixels. Default: as a camera.toml says, else
            the sensor's, or the centre.
        backend: egl, osmesa, or numpy, which needs no OpenGL. Default: the first that works.
    """
    from glsim.data.map_writer import MapWriter
    from glsim.data.maps import open_maps
    from glsim.settings.schema import load_settings
    from glsim.simulation.depth_noise import DepthNoise

    for text in assignments or []:
        if text.startswith(("pose.", "scene.", "source.", "appearance.", "motion.", "variation.")):
            raise ConfigError(f"--set {text}: has no effect on depth maps, which show their scene")
    if depth_unit_mm is not None and not 0.01 <= depth_unit_mm <= 10:
        raise ConfigError(f"--depth-unit-mm {depth_unit_mm:g}: give a step of 0.01 to 10 mm, in mm")
    over = overrides(sensor=sensor, seed=seed, output__depth_unit_mm=depth_unit_mm)
    settings = load_settings(config, assignments or [], over)
    given_mm = settings.output.depth_unit_mm
    given = given_mm if given_mm != 1 else depth_unit_mm
    recording = open_maps(
        clean,
        "clean",
        unit_mm=given,
        channel=channel,
        needs_camera=False,
        along_rays=along_ray,
        topic=topic,
    )
    names = (p.with_stem(re.sub("_clean$", "_noisy", p.stem)) for p in recording.outputs)
    recording = replace(recording, outputs=tuple(names))
    sensor = Path(settings.sensor).stem
    writer = MapWriter(recording, [clean], out, sensor=sensor)
    focal = centre = None
    camera = recording.camera or (recording.assumed_camera if recording.stated.sensor else None)
    if camera is not None:
        focal, centre = (camera.fx, camera.fy), (camera.cx, camera.cy)
    if focal_px is not None:
        focal = two_numbers("--focal-px", focal_px, or_one=True)
    if centre_px is not None:
        centre = two_numbers("--centre-px", centre_px)
    copies = Counter[str]()  # each copy of a map gets other noise
    with DepthNoise(settings, backend=backend, focal_px=focal, centre_px=centre) as noise:
        failures = writer.write(
            recording.frames.changed(partial(_with_noise, noise, copies)),
            skipped=lambda why: console.print(f"skipped {why}", style="yellow", soft_wrap=True),
        )
    assumed = "" if focal else "the camera of the maps is taken for the sensor's (--focal-px)"
    notes = (recording.sentence(camera=False), assumed, writer.sentence(f"noisy {sensor}"))
    for note in filter(None, notes):
        print_message(note)
    if failures:
        raise DatasetError(f"{failures} of {counted(len(writer.targets), 'map')} could not be read")


def _with_noise(noise: DepthNoise, copies: Counter[str], frame: DepthFrame) -> DepthFrame:
    from glsim.simulation.corrupt import noise_name

    name = noise_name(frame.clean_mm)
    made = noise.corrupt_depth(frame.in_metres("clean_mm"), frame=copies[name], sequence=name)
    copies[name] += 1
    left = (made.noisy > 0).sum() / max(1, (frame.clean_mm > 0).sum())
    if left <= 1 - _MOST_LOST and frame.clean_mm.any():
        lost = f"{100 * (1 - left):.4g} % of its depth is lost"
        raise DatasetError(f"{frame.name}: {lost}: check its unit and the camera")
    return frame.changed({"noisy_mm": made.measured(rounded=False).noisy_mm})
