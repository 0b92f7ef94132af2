"""``glsim corrupt``: add sensor noise to existing depth maps."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from glsim.cli.common import (
    ConfigOption,
    SeedOption,
    SensorOption,
    SetOption,
    console,
    overrides,
    print_message,
    two_numbers,
)
from glsim.core.errors import ConfigError, DatasetError

if TYPE_CHECKING:
    from glsim.data.recordings.files import MapFiles
    from glsim.settings.schema import Settings

EXAMPLES = """
glsim corrupt clean.png -o noisy.png
glsim corrupt maps/ -o noisy/ --sensor kinect-v2-paper --seed 3
glsim corrupt clean.png -o noisy.png --backend numpy --focal-px 575.8 --centre-px 320,240
"""


def corrupt(
    clean: Path,
    out: Annotated[Path, typer.Option("-o", "--out")],
    sensor: SensorOption = None,
    assignments: SetOption = None,
    seed: SeedOption = None,
    depth_unit_mm: float | None = None,
    focal_px: float | None = None,
    centre_px: str | None = None,
    config: ConfigOption = None,
    backend: str | None = None,
    channel: str | None = None,
) -> None:
    """Add the noise of a sensor to clean depth maps; 0 means no depth, in and out.

    Whole numbers are steps of --depth-unit-mm, floats of .npy, .exr and TIFF are metres, or
    millimetres if the median of a folder says so. What is beyond the sensor's far plane is no
    surface. A folder is read with its sub-folders; every map keeps its name. The noise of a map
    depends on the seed and on its depths, whatever its name and format; copies of a map have noise
    of their own, in the order of their names. Maps that cannot be read are reported and skipped. Of
    a folder that glsim wrote, only the clean depth is taken. Noisy PNGs state their step if the
    clean one does, or if it is not 1 mm.

    Args:
        clean: A clean depth map (16-bit PNG or TIFF, .npy, .exr), or a folder of them.
        out: The noisy map, or a folder for them.
        depth_unit_mm: Step of the depth files, mm. Default: what they state, else 1.
        focal_px: Focal length of the maps, pixels. Default: the sensor's.
        centre_px: Principal point x,y of the maps, pixels. Default: the sensor's, or the centre.
        backend: egl, osmesa, or numpy, which needs no OpenGL. Default: the first that works.
        channel: Channel of OpenEXR files. Default: the one whose name says depth.
    """
    from glsim.core.files.atomic import flush_outputs
    from glsim.data.recordings.names import left_out_text
    from glsim.denoise.depth_files import map_files
    from glsim.settings.schema import load_settings

    settings = load_settings(
        config,
        assignments or [],
        overrides(sensor=sensor, seed=seed, output__depth_unit_mm=depth_unit_mm),
    )
    pairs, others = _pairs(clean, out)
    given_mm = settings.output.depth_unit_mm
    given = given_mm if given_mm != 1 else depth_unit_mm
    maps = map_files([source for source, _ in pairs], given, channel)
    focal = None if focal_px is None else (focal_px, focal_px)
    centre = None if centre_px is None else two_numbers("--centre-px", centre_px)
    failures = _corrupt_maps(pairs, maps, settings, backend, focal, centre)
    if len(pairs) > 1:
        flush_outputs(out)
    if others:
        print_message(f"left out {left_out_text(others)}: no clean depth")
    for note in maps.notes:
        print_message(note)
    if focal is None:
        print_message("the camera of the maps is taken for the sensor's (--focal-px)")
    print_message(f"wrote {len(pairs) - failures} noisy depth map(s) to {out}")
    if failures:
        raise DatasetError(f"{failures} of {len(pairs)} maps could not be read")


def _corrupt_maps(
    pairs: Sequence[tuple[Path, Path]],
    maps: MapFiles,
    settings: Settings,
    backend: str | None,
    focal: tuple[float, float] | None,
    centre: tuple[float, float] | None,
) -> int:
    """Write the noisy maps; return the number of files that could not be read."""
    from glsim.core.files.atomic import write_atomic
    from glsim.core.files.png import stated_unit_mm
    from glsim.core.units import to_metres
    from glsim.data.map_files import encode_map, format_of
    from glsim.simulation.corrupt import noise_name
    from glsim.simulation.depth_noise import DepthNoise

    copies, failures, alone = Counter[str](), 0, len(pairs) == 1
    with DepthNoise(settings, backend=backend, focal_px=focal, centre_px=centre) as noise:
        for number, (source, target) in enumerate(pairs):
            try:
                depth_mm, _ = maps.depth(number)
            except DatasetError as error:
                if alone:
                    raise
                failures += 1
                console.print(f"skipped {error}", style="yellow", soft_wrap=True)
                continue
            name = noise_name(depth_mm)
            depth_m = to_metres(depth_mm)
            frame = noise.corrupt_depth(depth_m, frame=copies[name], sequence=name)
            copies[name] += 1
            stated = maps.step_mm != 1 or stated_unit_mm(source) is not None
            data = encode_map(frame.noisy_m, format_of(target), maps.step_mm, state_unit=stated)
            write_atomic(data, target, sync=alone)
    return failures


def _pairs(clean: Path, out: Path) -> tuple[list[tuple[Path, Path]], Counter[str]]:
    """List (input, output) of a file or of a folder's clean maps, and what is left out."""
    from glsim.data.recordings.names import maps_in
    from glsim.denoise.depth_files import check_name

    if not clean.exists():
        raise ConfigError(f"{clean}: no such file or folder")
    others: Counter[str] = Counter()
    if clean.is_file():
        target = out / clean.name if out.is_dir() else out
        check_name(target)
        pairs = [(clean, target)]
    else:
        if out.is_file():
            raise ConfigError(f"-o {out}: is a file; {clean} is a folder, so give a folder")
        files, others = maps_in(clean, "clean")
        pairs = [(file, out / file.relative_to(clean)) for file in files]
    for source, target in pairs:
        if target.exists() and target.samefile(source):
            raise ConfigError(f"-o {out}: would overwrite the clean map {source}")
    return pairs, others
