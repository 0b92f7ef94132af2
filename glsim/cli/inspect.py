"""``glsim inspect``: report the content of a face set, or of a recording of a depth camera."""

from __future__ import annotations

import shlex
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glsim.cli.common import (
    JsonOption,
    RotationOption,
    as_typed,
    make_console,
    print_json,
    print_written,
)
from glsim.core.errors import ConfigError, DatasetError, MeshError, NoDepthError, counted

if TYPE_CHECKING:
    from glsim.data.inspection import FaceSetReport
    from glsim.data.recording import Recording

#: Lines of each list. Chosen.
_LINES = 20


def inspect(
    path: Path,
    out: Annotated[Path | None, typer.Option("-o", "--out")] = None,
    frames: Annotated[int, typer.Option(min=0)] = 40,
    shown: Annotated[int, typer.Option(min=0, max=60)] = 12,
    unit: str = "auto",
    axes: str = "auto",
    rotation_deg: RotationOption = None,
    depth_unit_mm: float | None = None,
    topic: str | None = None,
    backend: str | None = None,
    as_json: JsonOption = False,
) -> None:
    """Report a face set's kind, people, frames, units, axes and problems, or a recording's camera.

    Args:
        path: A face set, a mesh file, or a recording of a depth camera.
        out: Folder or PNG file for a contact sheet of faces. Default: none.
        frames: Number of frames to read; 0 reads all.
        shown: Number of faces on the sheet; 0 draws none.
    """
    from glsim.core.files.png import write_picture
    from glsim.data import inspection
    from glsim.data.contact_sheet import gallery

    if not path.exists():
        raise ConfigError(f"{path}: no such file or folder")
    if out is not None and (out.is_dir() or not out.suffix):
        out /= "inspect.png"
    if out is not None and out.suffix.lower() != ".png":
        raise ConfigError(f"-o {out}: give a folder, or a name that ends in .png")
    if (recording := _recording(path, depth_unit_mm, topic)) is not None:
        if out is not None:
            raise ConfigError(f"-o {out}: a sheet of a recording: glsim preview {path} -o FOLDER")
        content = _camera(recording, depth_unit_mm, topic)
        if as_json:
            print_json(content)
        else:
            _print_camera(content)
        return
    kind, source = inspection.open_faces(path, unit, axes, rotation_deg)
    report = inspection.inspect(path, kind, source, frames)
    if as_json:
        print_json(_described(report))
    else:
        _print(report)
    if not report.usable:
        raise MeshError(f"{path}: none of {counted(report.checked, 'frame')} can be used")
    if shown and out is not None:
        step = max(1, len(report.usable) // shown)
        cells = list(inspection.preview_faces(source, report.usable[::step][:shown], backend))
        title = f"{path.name}: {kind}, {len(cells)} of {counted(report.frames, 'frame')}"
        write_picture(gallery(cells, title), out)
        print_written([out])


def _recording(path: Path, unit_mm: float | None, topic: str | None) -> Recording | None:
    """Open a recording; None for data sets, meshes and folders without depth maps."""
    from glsim.core.files.listing import files_below
    from glsim.data.header import is_dataset
    from glsim.data.inspection import recognise
    from glsim.data.maps import open_maps
    from glsim.data.recordings.names import words_of
    from glsim.faces.meshes.obj import EXTENSIONS

    if is_dataset(path) or path.suffix.lower() in EXTENSIONS:
        return None
    meshes = sorted(files_below(path, EXTENSIONS)) if path.is_dir() else []
    try:
        recording = open_maps(path, unit_mm=unit_mm, topic=topic)
    except NoDepthError as error:
        if path.is_dir() and not meshes and recognise(path) == "folder":
            raise ConfigError(f"{error}; nor meshes ({', '.join(EXTENSIONS)})") from None
        return None
    except DatasetError:
        if meshes:  # images beside meshes are textures of a face set
            return None
        raise
    if not meshes:
        return recording
    named = any("depth" in (f.parent.name, *words_of(f.name)) for f in recording.sources)
    if recording.kind == "biwi" or not named:  # a face set of that kind, or its textures
        return None
    beside = f"{counted(len(meshes), 'mesh', 'meshes')} beside it: glsim inspect {meshes[0]}"
    return replace(recording, notes=(*recording.notes, beside))


def _camera(recording: Recording, unit_mm: float | None, topic: str | None) -> dict[str, Any]:
    """Return the stated camera of a recording, the most similar sensor, and a denoiser for it."""
    from glsim.data.recordings.camera_file import StatedCamera
    from glsim.denoise.network_choice import choose_network, noise_of

    frame = recording.frames[0]
    height, width = frame.measured_mm.shape
    sensor, why, _ = recording.recognised
    network, command = choose_network(recording)[0], None
    if recording.votes.deepest_mm > 0:
        given = [("--depth-unit-mm", unit_mm and f"{unit_mm:g}"), ("--topic", topic)]
        more = [word for name, value in given if value for word in (name, value)]
        words = [str(recording.path), "-o", "denoised", "-d", network, *more]
        command = f"glsim denoise {shlex.join(words)}"
    return {
        "path": str(recording.path),
        "kind": recording.kind or "images",
        "frames": len(recording.frames),
        "width_px": width,
        "height_px": height,
        "step_mm": frame.step_mm,
        "infrared": recording.has_infrared,
        "stated_by": None if recording.stated == StatedCamera() else str(recording.stated_by),
        "intrinsics": None if recording.camera is None else asdict(recording.camera),
        "focal_px": frame.intrinsics.fx,
        "noise_mm": noise_of(recording.votes.maps_mm)[0] or None,
        "sensor": sensor or None,
        "because": why if sensor else None,
        "denoiser": network,
        "denoise": command,
        "notes": recording.sentence(camera=False, real=True),
    }


def _print_camera(content: dict[str, Any]) -> None:
    out = make_console(soft_wrap=True)
    step = f"steps of {content['step_mm']:g} mm" if content["step_mm"] else "not rounded"
    light = "with" if content["infrared"] else "without"
    out.print(
        f"{content['path']}: {content['kind']}, {counted(content['frames'], 'frame')} of "
        f"{content['width_px']} x {content['height_px']} px {light} infrared, {step}"
    )
    like = content["sensor"] and f"like {content['sensor']}, because {content['because']}"
    by = "stated" if content["intrinsics"] else "assumed"
    own = content["stated_by"] and f"like none shipped, stated by {content['stated_by']}"
    camera = like or own or "not recognised: state it in a camera.toml"
    out.print(f"camera: {camera}; f {content['focal_px']:.0f} px ({by})")
    if content["noise_mm"]:
        out.print(f"noise: {content['noise_mm']:.2g} mm between neighbours")
    denoise = content["denoise"]
    out.print(f"denoise: {denoise}" if denoise else "no depth: all sampled maps are 0")
    if content["notes"]:
        out.print(content["notes"])


def _described(report: FaceSetReport) -> dict[str, Any]:
    """Return the content of a face set as JSON values."""
    return {
        "path": str(report.root),
        "kind": report.kind,
        "people": {
            name: {"sequences": sequences, "frames": frames}
            for name, (sequences, frames) in report.people.items()
        },
        "frames": report.frames,
        "is_sample": report.is_sample,
        "frames_read": report.checked,
        "vertices": list(report.vertices),
        "triangles": list(report.triangles),
        "placements": dict(report.placements),
        "problems": dict(report.problems),
    }


def _print(report: FaceSetReport) -> None:
    out = make_console(soft_wrap=True)
    sequences = sum(count for count, _ in report.people.values())
    sample = "a sample of the people that it generates: " * report.is_sample
    out.print(
        f"{report.root}: {report.kind}, {sample}{counted(len(report.people), 'person', 'people')}, "
        f"{counted(sequences, 'sequence')}, {counted(report.frames, 'frame')}"
    )
    for name, (count, frames) in list(report.people.items())[:_LINES]:
        out.print(f"  {name}: {counted(count, 'sequence')}, {counted(frames, 'frame')}")
    if len(report.people) > _LINES:
        out.print(f"  and {len(report.people) - _LINES} more")
    out.print(
        f"{counted(report.checked, 'frame')} read: {_range(report.vertices)} vertices, "
        f"{_range(report.triangles)} triangles"
    )
    for how, count in report.placements.most_common(_LINES):
        out.print(f"  {count}: {how}")
    out.print("problems:" if report.problems else "no problems")
    for why, count in report.problems.most_common(_LINES):
        out.print(as_typed(f"  {count}: {why}"))


def _range(pair: tuple[int, int]) -> str:
    least, most = pair
    return str(least) if least == most else f"{least} to {most}"
