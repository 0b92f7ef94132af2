"""``glsim eval DATA --ssim-readings``: the paper's SSIM under every reading of its text."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

from glsim.cli.common import print_written


def study_ssim(dataset: Path, split: str, out: Path) -> None:
    """Compare readings of the paper's SSIM on a split; write ssim_readings.md to ``out``.

    Both depth protocols are measured, but one if the distance from the camera is unknown.

    Raises as ``open_frames`` does.
    """
    from glsim.depth_protocol import MEANING, DepthProtocol
    from glsim.eval.paper.ssim_page import ssim_document
    from glsim.eval.paper.ssim_readings import measure_readings
    from glsim.eval.scoring.pairs import open_frames
    from glsim.files.atomic import write_atomic

    stored = open_frames(dataset, split)
    known = (dataset / "dataset.json").is_file() or stored.protocol == "depth"
    protocols = get_args(DepthProtocol) if known else (stored.protocol,)
    cases = {
        f"Protocol {protocol}: {MEANING[protocol]}": measure_readings(
            open_frames(dataset, split, protocol=protocol)
        )
        for protocol in protocols
    }
    path = out / "ssim_readings.md"
    write_atomic(ssim_document(cases).markdown().encode(), path)
    print_written([path])
