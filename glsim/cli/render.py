"""``glsim render``: one mesh to a pair of frames."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import (
    BackendOption,
    ConfigOption,
    Debug,
    Quiet,
    SeedOption,
    SensorOption,
    SetOption,
    Verbose,
    listed,
    overrides,
    say,
)

EXAMPLES = """
[bold]Examples[/bold]

glsim render face.obj

glsim render scan.ply -o out --sensor kinect-v2-paper --seed 7

glsim render face.obj --raw --set scene.wall_mm=1300

glsim render face.glb --set pose.yaw_deg=30 --set tof_floor.sigma_mm=2 --set scene.wall_mm=1300
"""


def render(
    face: Annotated[Path, typer.Argument(help="A mesh: OBJ, PLY, STL, GLB, OFF.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the images.")] = Path(),
    sensor: SensorOption = None,
    assignments: SetOption = None,
    seed: SeedOption = None,
    crop: Annotated[int | None, typer.Option(help="Side of the centre crop, pixels.")] = None,
    depth_unit_mm: Annotated[float | None, typer.Option(help="Step of the depth files.")] = None,
    unit: Annotated[str, typer.Option(help="mm, cm, dm, m or inch; found by rule.")] = "auto",
    axes: Annotated[
        str, typer.Option(help="File axes that are x, y, z: +x+y+z; found by rule.")
    ] = "auto",
    raw: Annotated[
        bool, typer.Option("--raw", help="Also the Kinect V2's raw frame, for libfreenect2.")
    ] = False,
    config: ConfigOption = None,
    backend: BackendOption = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Render one mesh to a clean and a noisy depth map (16-bit PNG, millimetres).

    Writes FACE_clean.png, FACE_noisy.png, FACE_infrared.png, FACE_reason.png and FACE_preview.png;
    with --raw also FACE_raw.bin, ten packed sub-images of 11 bits, and FACE_p0.bin, their phase
    tables as libfreenect2 wants them.
    """
    from glsim import raw as raw_frames
    from glsim.cli.files import write_picture
    from glsim.config import SourceSettings, load_settings
    from glsim.dataset import write_frame
    from glsim.dataset.files import write_bytes
    from glsim.faces.one import OneMesh
    from glsim.frame import LAYERS, Frame
    from glsim.meshio import load_mesh
    from glsim.pipeline import simulate
    from glsim.preview import contact_sheet, of_frame
    from glsim.sensor import sensor_of

    given = overrides(
        sensor=sensor, seed=seed, output__crop=crop, output__depth_unit_mm=depth_unit_mm
    )
    settings = load_settings(config, assignments or [], {**given, "strict": True})
    loaded = load_mesh(face, unit=unit, axes=axes)
    source = OneMesh(loaded.mesh, face.stem, loaded.notes)
    single = SourceSettings(subjects=1, frames_per_subject=1)
    one = settings.model_copy(update={"source": (single,)})
    used = sensor_of(settings)
    if raw:
        raw_frames.taps_stage(used)
    extra = raw_frames.LAYERS if raw else ()
    for frame in simulate(one, sources=[source], backend=backend, extra_layers=extra):
        assert isinstance(frame, Frame), "strict: a bad face raises"
        paths = write_frame(frame, out, face.stem, LAYERS)
        preview = out / f"{face.stem}_preview.png"
        write_picture(contact_sheet([of_frame(frame)], f"{face.name}, {settings.sensor}"), preview)
        if raw:
            paths += [out / f"{face.stem}_raw.bin", out / f"{face.stem}_p0.bin"]
            write_bytes(raw_frames.packet(used, frame), paths[-2])
            write_bytes(raw_frames.p0_tables(), paths[-1])
        listed([*paths, preview])
        valid = int((frame.noisy_m > 0).sum())
        say(f"{int((frame.clean_m > 0).sum())} pixels of surface, {valid} measured")
