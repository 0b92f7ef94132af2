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
from glsim.core.units import add_offset, subtract_offset
from glsim.data.reader import Dataset, open_dataset
from glsim.denoise.registry import load_denoiser
from glsim.eval.paper.data_note import plan_size, run_note, source_name
from glsim.eval.paper.figures.solids import choose_frame, frustum_figure, rig_of, surfaces_figure
from glsim.eval.paper.ours_beside_printed import JUDGED, case_folder
from glsim.eval.paper.printed_values import PRINTED_FILTERS
from glsim.eval.report.document import CaptionedPng, Document, html_page
from glsim.eval.report.figures.panels import PanelRow, method_panels
from glsim.eval.report.figures.style import to_png
from glsim.eval.scoring.trained_networks import SeedGroup, find_trained_runs, group_by_network
from glsim.settings.toml_tables import read_toml

FOLDER: Final = "paper_figures"
#: Title of a column -> specification of its denoiser for ``glsim.load_denoiser``.
_Columns = dict[str, str]
_NOISY: Final[_Columns] = {"noisy\nBaseline": "noisy"}
_FIGURES: Final[dict[str, dict[str, Any]]] = read_toml(Path(__file__).with_name("figures.toml"))


def write_paper_figures(
    reproduction: Path, drawing: Callable[[str], None] = lambda _: None
) -> list[Path]:
    """Draw the paper's figures from a reproduction's data and networks; return the written files.

    Writes REPRODUCTION/paper_figures/figure_1.png to figure_6.png, captions.md, and
    paper_figures.html with all of them. Networks are those of the judged case, else those of
    REPRODUCTION/runs, of any size. Captions name missing networks; a figure without any is left
    out. ``drawing`` gets the name of each figure.

    Raises ConfigError without a data set, DatasetError, DenoiserError; GlsimError: no Matplotlib.
    """
    data, runs = reproduction / "data", case_folder(reproduction, *JUDGED) / "runs"
    if not any(runs.glob("*/best.pt")):
        runs = reproduction / "runs"
    if not data.is_dir():
        raise ConfigError(
            f"{reproduction}: has no data/ to draw: run glsim paper reproduce -o {reproduction} "
            "first"
        )
    dataset = open_dataset(data)
    trained = find_trained_runs(runs).runs if any(runs.glob("*/best.pt")) else []
    groups, note = group_by_network(trained), run_note(data, trained)
    pictures = []
    is_moved = runs.parent != reproduction  # both maps of a frame, as its networks need them
    for name, (caption, draw) in _figures(dataset, groups, note, is_moved).items():
        drawing(name)
        pictures.append(CaptionedPng(name, f"{caption} {note}", to_png(draw())))
    out = reproduction / FOLDER
    lines = [f"**{p.name}.png**: {p.caption}" for p in pictures]
    title = f"Figures after Kendrick, Yap and Tan{plan_size(reproduction)}"
    captions = Document(title, [lines])
    files = {f"{p.name}.png": p.png for p in pictures}
    files["captions.md"] = captions.markdown().encode()
    files["paper_figures.html"] = html_page(captions.title, [], pictures).encode()
    for name, content in files.items():
        write_atomic(content, out / name)
    return [out / name for name in files]


def _figures(
    dataset: Dataset, groups: Sequence[SeedGroup], note: str, is_moved: bool
) -> dict[str, tuple[str, Callable[[], Any]]]:
    """Return the figures, not yet drawn: name -> (caption, drawing function)."""
    example = choose_frame(dataset)
    drawn = choose_frame(dataset, is_moved=is_moved)
    scan = choose_frame(dataset, "facewarehouse")
    draw: dict[str, Callable[[], Any]] = {
        "figure_1": lambda: frustum_figure(example, rig_of(dataset), note),
        "figure_3": lambda: surfaces_figure(scan, note),
    }
    captions = {name: figure["caption"] for name, figure in _FIGURES.items()}
    captions["figure_3"] += f" Face: {source_name(scan.record['source'])}."
    for name, figure in _FIGURES.items():
        rows, shipped = figure.get("rows", ()), figure.get("shipped")
        columns = {PRINTED_FILTERS[name].title: name for name in figure.get("filters", ())}
        columns |= _network_columns(groups, rows)
        if missing := [row for row in rows if row not in {group.row for group in groups}]:
            captions[name] += f" Missing, without a checkpoint: {', '.join(missing)}."
        if shipped:
            others = [(g.title.rpartition(", ")[2], g.members[0]) for g in groups if not g.row]
            columns |= {f"ours, {w}\n{run.steps:,} steps": run.spec for w, run in others}
            columns[f"ours, {shipped}\nshipped"] = shipped
        if columns:
            draw[name] = partial(_panels, drawn, columns, figure["panels"], note)
    return {name: (captions[name], draw[name]) for name in sorted(draw)}


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
    maps = {}
    for title, spec in (_NOISY | columns).items():
        denoiser = load_denoiser(spec)
        offset_mm = frame.offset_mm if denoiser.protocol == "depth" else 0.0
        depth_mm = denoiser(add_offset(frame.noisy_mm, offset_mm)).depth_mm
        maps[title] = subtract_offset(depth_mm, offset_mm).astype(np.float32)
    return method_panels(frame, maps, rows, note)
