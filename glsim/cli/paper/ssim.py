"""``glsim paper ssim``: the paper's SSIM under every reading of its text."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from glsim.cli.common import print_written
from glsim.cli.eval import DatasetArgument, OutOption, RunsOption, SplitOption

EXAMPLES = """
[bold]Examples[/bold]

glsim paper ssim data -o ssim        which reading of the paper's SSIM gives its values

glsim paper ssim data --runs runs    with the rows of tables 2 and 3 that were trained
"""


def ssim(
    dataset: DatasetArgument,
    split: SplitOption = "test",
    out: OutOption = Path("scores"),
    runs: RunsOption = None,
) -> None:
    """Compute the paper's SSIM column under every reading of its text; write ssim_readings.md.

    Readings differ by data type, range, constants and implementation. Both depth protocols are
    measured, but one if the distance from the camera is unknown. Networks in --runs are measured
    under the protocol of their training, with their first seed.
    """
    from glsim.depth_protocol import MEANING, DepthProtocol
    from glsim.eval.paper.runs import row_networks
    from glsim.eval.paper.ssim_page import ssim_document
    from glsim.eval.paper.ssim_readings import measure_readings
    from glsim.eval.scoring.pairs import open_frames
    from glsim.files.atomic import write_atomic

    stored = open_frames(dataset, split)
    known = (dataset / "dataset.json").is_file() or stored.protocol == "depth"
    protocols = get_args(DepthProtocol) if known else (stored.protocol,)
    networks = {} if runs is None else row_networks(runs)
    cases = {
        f"Protocol {protocol}: {MEANING[protocol]}": measure_readings(
            open_frames(dataset, split, protocol=protocol),
            networks={r: n for r, n in networks.items() if n.protocol in (None, protocol)},
        )
        for protocol in protocols
    }
    path = out / "ssim_readings.md"
    write_atomic(ssim_document(cases).markdown().encode(), path)
    print_written([path])
