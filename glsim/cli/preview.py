"""``glsim preview``: draw a contact sheet of a data set and summarise its noise."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import print_message, print_written
from glsim.core.errors import ConfigError, DatasetError, counted

#: Number of frames for the summary of noise; more frames do not change the printed digits.
_MEASURED_FRAMES = 200


def preview(
    dataset: Annotated[Path | None, typer.Argument()] = None,
    out: Annotated[Path, typer.Option("-o", "--out")] = Path(),
    frames: Annotated[int, typer.Option(min=1, max=40)] = 6,
    split: str | None = None,
    surface: Annotated[bool, typer.Option("--3d")] = False,
    mesh: Annotated[bool, typer.Option("--mesh")] = False,
    depth_unit_mm: float | None = None,
    topic: str | None = None,
) -> None:
    """Draw a contact sheet of a data set or a recording, and summarise its noise.

    Writes contact_sheet.png (shaded clean, shaded noisy, difference, invalid mask) and summary.md.
    Without clean maps, as of a recording, it draws the noisy maps and the infrared.

    Args:
        dataset: A data set, or a recording of a depth camera. Default: an embedded head.
        out: Folder for the two files.
        frames: Number of frames on the contact sheet.
        split: train, val or test. Default: all.
        surface: Also write surface.html, the middle frame as shaded surfaces to turn in a browser.
        mesh: Also write face.obj, the embedded head at rest, mm. Only without a data set.
    """
    from glsim.core.files.atomic import write_atomic
    from glsim.core.files.png import write_picture
    from glsim.data.contact_sheet import contact_sheet
    from glsim.data.header import is_dataset
    from glsim.data.maps import open_maps
    from glsim.data.reader import open_dataset
    from glsim.measures.depth_errors import noise_table, recording_table

    if dataset is not None and mesh:
        raise ConfigError("--mesh writes an embedded head: leave the data set out")
    if dataset is None:
        from glsim.core.depth_frame import Frames
        from glsim.settings.schema import load_settings
        from glsim.simulation.pipeline import frames as simulated

        one = {"subjects": 1, "frames_per_subject": frames}
        head = load_settings(overrides={"output": {"crop": 256}}, source=one)
        drawn = [frame.measured() for frame in simulated(head)]
        pairs, sensor = Frames.of(drawn, "an embedded head"), f"an embedded head, {head.sensor}"
    elif is_dataset(dataset):
        opened = open_dataset(dataset)
        opened.require("noisy")
        pairs = opened.frames() if split is None else opened.split(split)
        sensor = opened.sensor_title
    elif split is not None:
        raise ConfigError(f"--split {split}: {dataset} is no data set")
    else:
        recording = open_maps(dataset, unit_mm=depth_unit_mm, topic=topic)
        pairs, sensor = recording.frames, recording.stated.name or dataset.name
        if sentence := recording.sentence():
            print_message(sentence)
    if len(pairs) == 0:
        raise DatasetError(f"{dataset}: has no frames to draw")
    # Frames are evenly spread, each from the middle of its interval, where expressions are strong.
    rows = min(frames, len(pairs))
    chosen = [int((row + 0.5) * len(pairs) / rows) for row in range(rows)]
    shown = [pairs[number] for number in chosen]
    sheet, summary = out / "contact_sheet.png", out / "summary.md"
    write_picture(contact_sheet(shown, sensor), sheet)
    measured = pairs[:: max(1, len(pairs) // _MEASURED_FRAMES)]
    table = noise_table if "clean_mm" in shown[0] else recording_table
    write_atomic(table(measured, sensor).encode(), summary)
    written = [sheet, summary]
    if surface:
        from glsim.data.surface_page import surface_page

        written.append(out / "surface.html")
        write_atomic(surface_page(pairs[len(pairs) // 2]).encode(), written[-1])
    if mesh:
        from glsim.faces.meshes.obj import encode_obj
        from glsim.faces.sources.procedural import ProceduralFaces

        written.append(out / "face.obj")
        write_atomic(encode_obj(*ProceduralFaces().neutral("p0000")), written[-1])
    print_written(written)
    if left_out := sorted({*range(len(pairs))} - {*chosen}):
        first = pairs[left_out[0]].name
        print_message(f"the sheet leaves out {counted(len(left_out), 'frame')}, first {first}")
