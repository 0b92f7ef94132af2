"""``glsim inspect``: report the contents of a face set, or the camera of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from glsim.cli.common import (
    BackendOption,
    JsonOption,
    make_console,
    print_json,
    print_message,
    print_written,
)
from glsim.errors import ConfigError, MeshError

if TYPE_CHECKING:
    from glsim.identify.evidence import Evidence
    from glsim.identify.ranking import Guess
    from glsim.inspection import FaceSetReport

EXAMPLES = """
[bold]Examples[/bold]

glsim inspect d3dfacs_alignments

glsim inspect FaceWarehouse_Data_0 -o look.png --frames 0

glsim inspect scan.ply --unit cm

glsim inspect recording/            which camera made these depth frames?

glsim inspect recording.bag
"""

_PEOPLE = 20
_PROBLEMS = 20
#: Cameras that are printed with their reasons: those that are at least this likely.
_LEAST_SHARE = 0.02
#: How sure an answer is, from this share on.
_WORDS = ((0.95, "sure"), (0.75, "likely"), (0.0, "possible"))


def inspect(
    path: Annotated[Path, typer.Argument(help="A face set, a mesh, or a recording of depth.")],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Folder or PNG file for the contact sheet.")
    ] = Path("inspect.png"),
    frames: Annotated[int, typer.Option(min=0, help="Number of frames to read; 0 reads all.")] = 40,
    shown: Annotated[
        int, typer.Option(min=0, max=60, help="Number of faces on the sheet; 0 draws none.")
    ] = 12,
    unit: Annotated[
        str, typer.Option(help="Unit of the mesh files; overrides detection.")
    ] = "auto",
    axes: Annotated[
        str, typer.Option(help="Axes of the mesh files; overrides detection.")
    ] = "auto",
    backend: BackendOption = None,
    as_json: JsonOption = False,
) -> None:
    """Detect the kind of a face set, print people, frames, units, axes, problems; draw faces.

    Of a recording (a folder of depth maps without meshes, a .bag, .mkv or .npy file) it says which
    camera made it, how sure that is and why: by the lattice of its depths, the image's size, noise,
    holes and infrared. No label is needed; "unknown" is an answer too.
    """
    from glsim import inspection
    from glsim.files.png import write_picture
    from glsim.preview import gallery

    if not path.exists():
        raise ConfigError(f"{path}: no such file or folder")
    if recordings := inspection.find_recordings(path):
        _print_cameras(recordings, as_json)
        return
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


def _print_cameras(recordings: list[Path], as_json: bool) -> None:
    """Print the camera of each recording; of several, those that cannot be read are named."""
    from glsim.errors import DatasetError

    described = []
    for recording in recordings:
        try:
            if as_json:
                described.append(_described_camera(recording))
            else:
                _print_camera(recording)
        except DatasetError as error:
            if len(recordings) == 1:
                raise
            print_message(str(error))
    if as_json:
        print_json(described)


def _described_camera(path: Path) -> dict[str, Any]:
    """Return what tells the camera of a recording as JSON values."""
    from glsim.identify.evidence import gather_evidence
    from glsim.identify.ranking import rank_cameras
    from glsim.recordings.recording import open_recording

    evidence = gather_evidence(open_recording(path))
    return {
        "recording": str(path),
        "frames": evidence.frames,
        "size_px": list(evidence.size),
        "unit_mm": evidence.unit_mm,
        "stated": evidence.stated,
        "cameras": [
            {"title": g.title, "sensor": g.sensor, "share": float(g.share),
             "reasons": list(g.reasons)}
            for g in rank_cameras(evidence)
        ],
    }  # fmt: skip


def _described(report: FaceSetReport) -> dict[str, Any]:
    """Return the contents of a face set as JSON values."""
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


def _print_camera(path: Path) -> None:
    from glsim.identify.evidence import gather_evidence
    from glsim.identify.ranking import UNKNOWN, rank_cameras
    from glsim.recordings.recording import open_recording

    out = make_console(soft_wrap=True)
    recording = open_recording(path)
    evidence = gather_evidence(recording)
    guesses = rank_cameras(evidence)
    out.print(f"{path}: {_contents(evidence)}")
    for guess in guesses:
        if guess is guesses[0] or (guess.share >= _LEAST_SHARE and guess.title != UNKNOWN):
            _print_guess(guess)
    if evidence.stated:
        out.print(f"  the recording says: {evidence.stated}")
    for note in recording.notes:
        print_message(note)


def _print_guess(guess: Guess) -> None:
    out = make_console(soft_wrap=True)
    sure = next(word for share, word in _WORDS if guess.share >= share)
    sensor = f" (sensor {guess.sensor})" if guess.sensor else ""
    out.print(f"  {guess.title}{sensor}: {sure}, {100 * guess.share:.0f} %")
    for reason in guess.reasons:
        out.print(f"    {reason}")
    if not guess.sensor:
        out.print("    no camera that glsim knows fits what the frames show")


def _contents(evidence: Evidence) -> str:
    width, height = evidence.size
    values, holes = evidence.values, evidence.holes
    step = "their step" if evidence.unit_mm is None else f"{evidence.unit_mm:g} mm"
    text = (
        f"{evidence.frames} frames of {width}x{height}, {values.size:,} different depths from "
        f"{values.min():.0f} to {values.max():.0f} in units of {step}, {100 * holes[0]:.1f} % "
        f"holes ({100 * holes[1]:.1f} % right of the left border's band)"
    )
    return text + ("" if evidence.infrared is None else ", infrared")


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
