"""``glsim inspect``: report the content of a face set."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glsim.cli.common import (
    BackendOption,
    JsonOption,
    make_console,
    print_json,
    print_written,
)
from glsim.core.errors import ConfigError, MeshError

if TYPE_CHECKING:
    from glsim.data.inspection import FaceSetReport

EXAMPLES = """
glsim inspect d3dfacs_alignments
glsim inspect FaceWarehouse_Data_0 -o look.png --frames 0
glsim inspect scan.ply --unit cm
"""

_PEOPLE = 20
_PROBLEMS = 20


def inspect(
    path: Path,
    out: Annotated[Path, typer.Option("-o", "--out")] = Path("inspect.png"),
    frames: Annotated[int, typer.Option(min=0)] = 40,
    shown: Annotated[int, typer.Option(min=0, max=60)] = 12,
    unit: str = "auto",
    axes: str = "auto",
    backend: BackendOption = None,
    as_json: JsonOption = False,
) -> None:
    """Report a face set's kind, people, frames, units, axes and problems; draw its faces.

    Args:
        path: A face set or a mesh file.
        out: Folder or PNG file for the contact sheet.
        frames: Number of frames to read; 0 reads all.
        shown: Number of faces on the sheet; 0 draws none.
        unit: Unit of the mesh files; overrides detection.
        axes: Axes of the mesh files; overrides detection.
    """
    from glsim.core.files.png import write_picture
    from glsim.data import inspection
    from glsim.data.contact_sheet import gallery

    if not path.exists():
        raise ConfigError(f"{path}: no such file or folder")
    if out.is_dir() or not out.suffix:
        out /= "inspect.png"
    if out.suffix.lower() != ".png":
        raise ConfigError(f"-o {out}: give a folder, or a name that ends in .png")
    kind, source = inspection.open_faces(path, unit, axes)
    report = inspection.inspect(path, kind, source, frames)
    if as_json:
        print_json(_described(report))
    else:
        _print(report)
    if not report.usable:
        raise MeshError(f"{path}: none of the {report.checked} frames that were read can be used")
    if shown:
        step = max(1, len(report.usable) // shown)
        cells = list(inspection.preview_faces(source, report.usable[::step][:shown], backend))
        write_picture(gallery(cells, f"{path.name}: {kind}, {report.frames} frames"), out)
        print_written([out])


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
        "frames_read": report.checked,
        "vertices": list(report.vertices),
        "triangles": list(report.triangles),
        "placements": dict(report.placements),
        "problems": dict(report.problems),
    }


def _print(report: FaceSetReport) -> None:
    out = make_console(soft_wrap=True)
    sequences = sum(count for count, _ in report.people.values())
    out.print(
        f"{report.root}: {report.kind}, {len(report.people)} people, {sequences} sequences, "
        f"{report.frames} frames",
    )
    for name, (count, frames) in list(report.people.items())[:_PEOPLE]:
        out.print(f"  {name}: {count} sequences, {frames} frames")
    if len(report.people) > _PEOPLE:
        out.print(f"  and {len(report.people) - _PEOPLE} more")
    out.print(
        f"{report.checked} frames read: {_range(report.vertices)} vertices, "
        f"{_range(report.triangles)} triangles"
    )
    for how, count in report.placements.most_common(_PEOPLE):
        out.print(f"  {count}: {how}")
    out.print("problems:" if report.problems else "no problems")
    for why, count in report.problems.most_common(_PROBLEMS):
        out.print(f"  {count}: {why}")


def _range(pair: tuple[int, int]) -> str:
    least, most = pair
    return str(least) if least == most else f"{least} to {most}"
