"""Draw the paper's figures 1 to 5 from a reproduction's folder, and figure 6 with our networks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from glsim.core.depth_frame import DepthFrame
from glsim.core.errors import ConfigError
from glsim.core.files.atomic import write_atomic
from glsim.data.reader import Dataset, open_dataset
from glsim.denoise.registry import load_denoiser
from glsim.eval.paper.data_note import data_note, source_name
from glsim.eval.paper.figures.solids import choose_frame, frustum_figure, rig_of, surfaces_figure
from glsim.eval.paper.paper_tables import with_twins
from glsim.eval.paper.printed_values import PRINTED_FILTERS
from glsim.eval.report.document import CaptionedPng, Document, html_page
from glsim.eval.report.figures.panels import PanelRow, method_panels
from glsim.eval.report.figures.style import to_png
from glsim.eval.scoring.trained_networks import SeedGroup, find_trained_runs, group_by_network

FOLDER: Final = "paper_figures"
#: Title of a column -> specification of its denoiser for ``glsim.load_denoiser``.
_Columns = dict[str, str]
_NOISY: Final[_Columns] = {"noisy\nBaseline": "noisy"}
#: The filters of figure 2, in the order of the paper's table 1.
_FILTERS: Final = ("median", "nlm", "adaptive", "bilateral")
#: Name of a figure of networks -> (rows of the paper's tables, kinds of panels, caption).
_NETWORKS: Final[dict[str, tuple[tuple[str, ...], tuple[PanelRow, ...], str]]] = {
    "figure_4": (
        ("Restormer", "UNet"),
        ("depth", "error", "side"),
        "Restormer and UNet: depth, error, and the surface seen from 30 degrees aside.",
    ),
    "figure_5": (
        ("D7", "D20", "D64", "AR D7", "AR D20", "AR D64"),
        ("depth", "error", "normals"),
        "DnCNN with 7, 20 and 64 layers, without and with artefact removal (AR), where a row with "
        "AR is its partner's network: depth, error, and normal maps.",
    ),
}
#: Networks of figure 6: the paper's, by its table row, and ours, by the name of its file.
_THEIRS, _SHIPPED = "D20", "face"


def write_paper_figures(
    reproduction: Path, drawing: Callable[[str], None] = lambda _: None
) -> list[Path]:
    """Draw the figures from REPRODUCTION/data and REPRODUCTION/runs; return the written files.

    Writes REPRODUCTION/paper_figures/figure_1.png to figure_6.png, captions.md, and
    paper_figures.html with all of them. The folder's networks are drawn, of any size. Captions name
    missing networks; a figure without any is left out. ``drawing`` gets the name of each figure.

    Raises ConfigError without a data set, DatasetError, DenoiserError; GlsimError: no Matplotlib.
    """
    data, runs = reproduction / "data", reproduction / "runs"
    if not data.is_dir():
        raise ConfigError(
            f"{reproduction}: has no data/ to draw: run glsim paper reproduce -o {reproduction} "
            "first"
        )
    dataset = open_dataset(data)
    trained = find_trained_runs(runs).runs if any(runs.glob("*/best.pt")) else []
    groups = with_twins(group_by_network(trained))
    note = data_note(dataset)
    pictures = []
    for name, (caption, draw) in _figures(dataset, groups, note).items():
        drawing(name)
        pictures.append(CaptionedPng(name, f"{caption} {note}", to_png(draw())))
    out = reproduction / FOLDER
    lines = [f"**{p.name}.png**: {p.caption}" for p in pictures]
    captions = Document("Figures after Kendrick, Yap and Tan", [lines])
    files = {f"{p.name}.png": p.png for p in pictures}
    files["captions.md"] = captions.markdown().encode()
    files["paper_figures.html"] = html_page(captions.title, [], pictures).encode()
    for name, content in files.items():
        write_atomic(content, out / name)
    return [out / name for name in files]


def _figures(
    dataset: Dataset, groups: Sequence[SeedGroup], note: str
) -> dict[str, tuple[str, Callable[[], Any]]]:
    """Return the figures, not yet drawn: name -> (caption, drawing function)."""
    example = choose_frame(dataset)
    scan = choose_frame(dataset, "facewarehouse")
    figures: dict[str, tuple[str, Callable[[], Any]]] = {
        "figure_1": (
            "The viewing frustum of the sensor with the head in it, camera and projector; right, "
            "what the camera sees of the head, and where the projector's light does not reach.",
            lambda: frustum_figure(example, rig_of(dataset), note),
        ),
        "figure_2": (
            "The paper's filters beside the truth: depth, error, and the surface seen from 30 "
            "degrees aside. Adaptive is a filter over time, on single frames the identity.",
            lambda: _panels(
                example,
                {PRINTED_FILTERS[name].title: name for name in _FILTERS},
                ("depth", "error", "side"),
                note,
            ),
        ),
        "figure_3": (
            f"A depth map in 3D, left clean, right noisy: {source_name(scan.record['source'])}.",
            lambda: surfaces_figure(scan, note),
        ),
    }
    for name, (rows, kinds, caption) in _NETWORKS.items():
        columns = _network_columns(groups, rows)
        missing = [row for row in rows if row not in {group.row for group in groups}]
        if columns:
            lacks = f" Missing, without a checkpoint: {', '.join(missing)}." if missing else ""
            draw = partial(_panels, example, columns, kinds, note)
            figures[name] = (caption + lacks, draw)
    others = [(g.title.rpartition(", ")[2], g.members[0]) for g in groups if not g.row]
    ours = {f"ours, mask-aware\n{w}, {run.steps:,} steps": run.spec for w, run in others}
    shipped = {f"ours, {_SHIPPED}\nshipped": _SHIPPED}
    beside = _network_columns(groups, (_THEIRS,)) | ours | shipped
    figures["figure_6"] = (
        f"Ours in the place of theirs. The shipped network `{_SHIPPED}` is trained on other "
        "sensors and heads; the mask-aware networks are trained on the pairs of this data set, "
        f"like {_THEIRS}.",
        lambda: _panels(example, beside, ("depth", "error", "side", "normals"), note),
    )
    return figures


def _network_columns(groups: Sequence[SeedGroup], rows: Sequence[str]) -> _Columns:
    """Return a figure column for each trained table row: its first seed at the largest size."""
    columns = {}
    for row in rows:
        of_row = sorted((g for g in groups if g.row == row), key=lambda g: g.size == "full")
        if of_row:
            run = of_row[-1].members[0]
            columns[f"{row}\n{run.size}, {run.steps:,} steps"] = run.spec
    return columns


def _panels(frame: DepthFrame, columns: _Columns, rows: Sequence[PanelRow], note: str) -> Any:
    """Draw the frame as denoised by each method; networks use the default composite."""
    maps = {
        title: load_denoiser(spec)(frame.noisy_mm).depth_mm.astype(np.float32)
        for title, spec in (_NOISY | columns).items()
    }
    return method_panels(frame, maps, rows, note)
