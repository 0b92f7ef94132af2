"""``glsim preview``: look at a data set."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from glsim.cli.common import Debug, Quiet, Verbose, listed
from glsim.errors import DatasetError

EXAMPLES = """
[bold]Examples[/bold]

glsim preview data

glsim preview data -o pictures --frames 12 --split test
"""

#: Frames whose noise is summed up; more change no digit that is printed.
_MEASURED = 200


def preview(
    dataset: Annotated[Path, typer.Argument(help="Folder of a data set.")],
    out: Annotated[Path, typer.Option("-o", "--out", help="Folder for the two files.")] = Path(),
    frames: Annotated[int, typer.Option(min=1, max=40, help="Rows of the contact sheet.")] = 6,
    split: Annotated[str | None, typer.Option(help="train, val or test; default: all.")] = None,
    quiet: Quiet = False,
    verbose: Verbose = False,
    debug: Debug = False,
) -> None:
    """Draw a contact sheet of a data set and sum up its noise.

    Writes contact_sheet.png (shaded clean, shaded noisy, difference, invalid mask) and summary.md.
    """
    from glsim.cli.files import write_picture
    from glsim.dataset import open_dataset
    from glsim.dataset.files import write_bytes
    from glsim.dataset.reader import read_header
    from glsim.preview import contact_sheet, of_pair
    from glsim.summary import as_markdown, measure

    opened = open_dataset(dataset)
    pairs = opened if split is None else opened.split(split)
    if len(pairs) == 0:
        raise DatasetError(f"{dataset}: has no frames to look at")
    get = opened.pair if split is None else opened.split(split).__getitem__
    # Evenly over the frames, from the middle of each share, so that expressions are at work.
    rows = min(frames, len(pairs))
    shown = [of_pair(get(int((row + 0.5) * len(pairs) / rows))) for row in range(rows)]
    sensor = str(read_header(dataset)["sensor"]["title"])
    sheet, summary = out / "contact_sheet.png", out / "summary.md"
    write_picture(contact_sheet(shown, sensor), sheet)
    step = max(1, len(pairs) // _MEASURED)
    noise = measure(get(number) for number in range(0, len(pairs), step))
    write_bytes(as_markdown(noise, sensor).encode(), summary)
    listed([sheet, summary])
