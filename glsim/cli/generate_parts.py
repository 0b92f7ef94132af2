"""``glsim generate --part``, ``--merge`` and ``--slurm``: data sets made by several jobs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from glsim.cli.common import console, print_message
from glsim.cli.generation_summary import print_summary
from glsim.cli.progress import generation_progress
from glsim.errors import ConfigError

if TYPE_CHECKING:
    from glsim.settings.schema import Settings


def make_one_part(settings: Settings, out: Path, part: str, options: Mapping[str, Any]) -> None:
    """Make the part that ``part`` names, and print what it did.

    Args:
        options: of generate_part.
    """
    from glsim.dataset import generate_part, parse_part

    chosen = parse_part(part, os.environ)
    with generation_progress() as progress:
        summary = generate_part(settings, out, chosen, **options, progress=progress)
    if summary.left:
        console.print(f"part {chosen} is left to the others: {summary.left}", style="yellow")
        return
    taken = "".join(f", and part {other}, which another machine left" for other in summary.taken)
    print_message(
        f"{out}: part {chosen}{taken}: {summary.frames} frames and {summary.skipped} skipped, "
        f"{summary.rendered} of them in this run of {summary.seconds:.1f} s"
    )
    if summary.dataset is not None:
        print_summary(summary.dataset, out)
    else:
        print_message(
            f"{summary.absent_chunks} chunks of other parts are not made yet; the last part merges"
        )


def merge_all_parts(settings: Settings, out: Path) -> None:
    """Complete the data set whose parts are made, and print what it holds."""
    from glsim.dataset import merge_parts

    print_summary(merge_parts(settings, out), out)


def submit_parts(
    settings: Settings, out: Path, parts: int, slurm: Sequence[str], options: Mapping[str, Any]
) -> None:
    """Submit the parts to Slurm, show their progress, and print what the data set holds."""
    from glsim.dataset.slurm import generate_on_slurm, slurm_options

    if parts < 1:
        raise ConfigError(f"--slurm {parts}: give a number of jobs of at least 1")
    slurm_settings = slurm_options(slurm)
    if options["workers"] == "auto" and "cpus_per_task" in slurm_settings:
        options = {**options, "workers": slurm_settings["cpus_per_task"]}
    with generation_progress() as progress:
        summary = generate_on_slurm(
            settings, out, parts, slurm=slurm_settings, progress=progress, **options
        )
    print_summary(summary, out)
