"""``glsim corrupt``: add sensor noise to existing depth maps."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
    from numpy.typing import NDArray

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
) -> None:
    """Add the noise of a sensor to clean depth maps; 0 means no depth, in and out.

    Whole numbers are steps of --depth-unit-mm, floats of .npy, .exr and TIFF are metres.
    A folder is read with its sub-folders; every .png keeps its name. The noise of a map depends on
    the seed and on its name. Maps that cannot be read are reported and skipped. Of a folder that
    glsim wrote, only the clean depth is taken. Noisy PNGs state their step if the clean one does,
    or if it is not 1 mm.

    Args:
        clean: A clean depth map (16-bit PNG or TIFF, .npy, .exr), or a folder of them.
        out: The noisy map, or a folder for them.
        depth_unit_mm: Step of the depth files, mm.
        focal_px: Focal length of the maps, pixels. Default: the sensor's.
        centre_px: Principal point x,y of the maps, pixels. Default: the sensor's, or the centre.
        backend: egl, osmesa, or numpy, which needs no OpenGL.
    """
    import numpy as np

    from glsim.core.files.atomic import flush_outputs, write_atomic
    from glsim.core.files.png import encode_png, read_depth_png, stated_unit_mm
    from glsim.data.map_files import check_stated_unit, encode_map, format_of, read_map_mm
    from glsim.data.recordings.names import left_out_text
    from glsim.denoise.depth_files import left_out_of
    from glsim.settings.schema import load_settings
    from glsim.simulation.corrupt import Corrupter

    settings = load_settings(
        config,
        assignments or [],
        overrides(sensor=sensor, seed=seed, output__depth_unit_mm=depth_unit_mm),
    )
    pairs = _pairs(clean, out)
    unit_mm = settings.output.depth_unit_mm
    focal = None if focal_px is None else (focal_px, focal_px)
    centre = None if centre_px is None else two_numbers("--centre-px", centre_px)
    failures = 0
    with ExitStack() as stack:
        by_shape: dict[tuple[int, int], Corrupter] = {}
        for source, target, name in pairs:
            try:
                check_stated_unit(source, unit_mm)
                stated = unit_mm if unit_mm != 1 or stated_unit_mm(source) is not None else None
                whole = source.suffix.lower() == ".png" == target.suffix.lower()
                depth: NDArray[Any] = (
                    read_depth_png(source) if whole else read_map_mm(source, unit_mm)
                )
            except DatasetError as error:
                if source == clean:
                    raise
                failures += 1
                console.print(f"skipped {error}", style="yellow")
                continue
            shape = (depth.shape[0], depth.shape[1])
            if shape not in by_shape:
                corrupter = Corrupter(settings, shape, backend, focal, centre)
                by_shape[shape] = stack.enter_context(corrupter)
            if depth.dtype == np.uint16:
                data = encode_png(by_shape[shape].corrupt(depth, name).noisy, stated)
            else:
                frame = by_shape[shape].corrupt_depth(depth / np.float32(1000), sequence=name)
                data = encode_map(
                    frame.noisy_m, format_of(target), unit_mm, state_unit=stated is not None
                )
            write_atomic(data, target, sync=len(pairs) == 1)
    if len(pairs) > 1:
        flush_outputs(out)
    if others := left_out_of([clean], "clean"):
        print_message(f"left out {left_out_text(others)}: no clean depth")
    print_message(f"wrote {len(pairs) - failures} noisy depth map(s) to {out}")
    if failures:
        raise DatasetError(f"{failures} of {len(pairs)} maps could not be read")


def _pairs(clean: Path, out: Path) -> list[tuple[Path, Path, str]]:
    """List (input, output, name that decides the noise) of a file or of a folder's clean maps."""
    from glsim.denoise.depth_files import check_name, maps_in

    if not clean.exists():
        raise ConfigError(f"{clean}: no such file or folder")
    if clean.is_file():
        target = out / clean.name if out.is_dir() else out
        check_name(target)
        pairs = [(clean, target, clean.stem)]
    else:
        if out.is_file():
            raise ConfigError(f"-o {out}: is a file; {clean} is a folder, so give a folder")
        names = [path.relative_to(clean) for path in maps_in(clean, "clean")]
        pairs = [(clean / name, out / name, name.with_suffix("").as_posix()) for name in names]
    for source, target, _ in pairs:
        if target.exists() and target.samefile(source):
            raise ConfigError(f"-o {out}: would overwrite the clean map {source}")
    return pairs
