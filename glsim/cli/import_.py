"""``glsim import``: convert real depth maps to a data set."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from glsim.cli.common import PlainCommand, epilog, with_messages


class _KindFinder(TyperGroup):
    """The commands of ``import``; for a path without a command, the kind of recordings decides."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Insert the command before a path: biwi if a template NN.obj is beside a folder NN."""
        if args and args[0] not in self.commands and not args[0].startswith("-"):
            args = ["biwi" if any(Path(args[0]).glob("[0-9][0-9].obj")) else "kinect2", *args]
        return super().parse_args(ctx, args)


app = typer.Typer(
    cls=_KindFinder,
    help="Convert real depth maps to a data set: glsim import DIR -o OUT finds the kind.",
    epilog=epilog("import"),
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
)


@app.command(
    "biwi",
    cls=PlainCommand,
    short_help="Frames of Biwi's head poses.",
    epilog=epilog("import biwi"),
)
@with_messages
def biwi(
    root: Path,
    out: Annotated[Path, typer.Option("-o", "--out")],
    every: Annotated[int, typer.Option(min=1)] = 1,
    subjects: int | None = None,
    frames_per_subject: int | None = None,
    split: str | None = None,
    workers: str = "auto",
    backend: str | None = None,
) -> None:
    """Write Biwi's real Kinect frames as noisy maps; the posed templates give the clean maps.

    Args:
        root: Folder with NN.obj and NN/frame_*_depth.bin.
        subjects: Number of people. Default: all.
        frames_per_subject: Frames per person. Default: all.
        split: Shares of train,val,test, or paper for the paper's. Default: 0.7,0.12,0.18.
    """
    from glsim.cli.progress import frame_progress, print_summary
    from glsim.data.recordings.imports import import_biwi
    from glsim.data.worker_processes import worker_count

    with frame_progress() as progress:
        summary = import_biwi(
            root, out, every=every, subjects=subjects, frames_per_subject=frames_per_subject,
            split=split, workers=worker_count(workers), backend=backend, progress=progress,
        )  # fmt: skip
    print_summary(summary, out)


@app.command(
    "kinect2",
    cls=PlainCommand,
    short_help="Recordings of any depth camera.",
    epilog=epilog("import kinect2"),
)
@with_messages
def kinect2(
    root: Annotated[Path, typer.Argument(metavar="DIR")],
    out: Annotated[Path, typer.Option("-o", "--out")],
    depth_unit_mm: float | None = None,
    mirror: Annotated[bool, typer.Option("--mirror")] = False,
    every: Annotated[int, typer.Option(min=1)] = 1,
    split: str | None = None,
    topic: str | None = None,
    workers: str = "1",
) -> None:
    """Write recordings of a Kinect V2 or another depth camera; the data set has no clean maps.

    Args:
        root: A recording, or a folder of recordings: NNNN_depth.png and NNNN_ir.png of iai_kinect2,
            16-bit PNG or TIFF files, .npy stacks, dumps of libfreenect2, .bag, .mcap, .mkv.
        mirror: Flip left and right, as libfreenect2's dumps need.
        split: Shares of train,val,test. Default: 0,0,1 (all test).
    """
    from glsim.cli.progress import frame_progress, print_summary
    from glsim.data.recordings.imports import import_recordings
    from glsim.data.worker_processes import worker_count

    with frame_progress() as progress:
        summary = import_recordings(
            root, out, depth_unit_mm=depth_unit_mm, mirror=mirror, every=every, split=split,
            topic=topic, workers=worker_count(workers), progress=progress,
        )  # fmt: skip
    print_summary(summary, out)
