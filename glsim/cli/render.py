"""``glsim render``: render a mesh to a pair of clean and noisy depth maps."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import (
    PresetOption,
    RotationOption,
    SensorOption,
    SetOption,
    overrides,
    print_message,
    print_written,
)
from glsim.core.errors import ConfigError
from glsim.data.disk_format import HEADER


def render(
    face: Path,
    out: Annotated[Path, typer.Option("-o", "--out")] = Path(),
    sensor: SensorOption = None,
    assignments: SetOption = None,
    seed: int | None = None,
    crop: int | None = None,
    depth_unit_mm: float | None = None,
    unit: str = "auto",
    axes: str = "auto",
    rotation_deg: RotationOption = None,
    preset: PresetOption = None,
    config: Path | None = None,
    backend: str | None = None,
) -> None:
    """Render a mesh to a clean and a noisy depth map (16-bit PNG, millimetres).

    Writes FACE_clean.png, FACE_noisy.png, FACE_infrared.png, FACE_reason.png and FACE_preview.png.

    Args:
        out: Folder for the images.
        crop: Side of the centre crop, pixels. Default: the whole image.
        depth_unit_mm: Step of the depth files, mm. Default: 1.
    """
    from glsim.core.files.png import write_picture
    from glsim.data.contact_sheet import contact_sheet
    from glsim.data.layer_images import write_frame
    from glsim.faces.meshes.load import load_mesh
    from glsim.faces.one_mesh import OneMesh
    from glsim.settings.schema import load_settings
    from glsim.settings.source_settings import parse_source
    from glsim.simulation.frame import LAYERS, Frame
    from glsim.simulation.no_effect import no_effect
    from glsim.simulation.pipeline import simulate

    if (face / HEADER).is_file():
        raise ConfigError(f"{face}: is a data set, not a mesh: glsim preview {face} shows it")
    given = overrides(
        sensor=sensor, seed=seed, output__crop=crop, output__depth_unit_mm=depth_unit_mm
    )
    settings = load_settings(config, assignments or [], {**given, "strict": True}, preset=preset)
    loaded = load_mesh(face, unit=unit, axes=axes, rotation_deg=rotation_deg)
    print_message(f"{face}: {loaded.alignment}")
    source = OneMesh(loaded.mesh, face.stem, loaded.notes)
    for line in no_effect(settings, [source]):
        print_message(line)
    single = parse_source({"subjects": 1, "frames_per_subject": 1})
    one_frame = settings.model_copy(update={"source": (single,)})
    for frame in simulate(one_frame, sources=[source], backend=backend):
        assert isinstance(frame, Frame), "a bad face raises, because strict is set"
        paths = write_frame(frame, out, face.stem, LAYERS, Path(settings.sensor).stem)
        preview = out / f"{face.stem}_preview.png"
        sheet = contact_sheet([frame.measured(rounded=False)], f"{face.name}, {settings.sensor}")
        write_picture(sheet, preview)
        print_written([*paths, preview])
        surface, valid = (int((map_m > 0).sum()) for map_m in (frame.clean_m, frame.noisy_m))
        print_message(f"surface in {surface} pixels, depth measured in {valid}")
