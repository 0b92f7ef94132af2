"""Draw the paper's figures 1 to 5 from a reproduction's folder, and figure 6 with our networks."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from glsim.dataset import Dataset, open_dataset
from glsim.errors import ConfigError
from glsim.eval.paper.data_note import data_note, source_name
from glsim.eval.paper.figures.frames import (
    Column,
    FigureFrame,
    choose_frame,
    denoise,
    network_columns,
)
from glsim.eval.paper.figures.frustum import frustum_figure
from glsim.eval.paper.figures.panels import PanelRow, panel_figure
from glsim.eval.paper.figures.surfaces import surfaces_figure
from glsim.eval.paper.printed_values import PRINTED_FILTERS
from glsim.eval.paper.runs import (
    ARTEFACT_REMOVAL,
    SeedGroup,
    find_trained_runs,
    group_by_network,
)
from glsim.eval.report.document import CaptionedPng, Document
from glsim.eval.report.figures.style import to_png
from glsim.eval.report.page import html_page
from glsim.files.atomic import write_atomic

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Folder of the figures in that of the reproduction.
FOLDER: Final = "paper_figures"
_NOISY: Final = Column("noisy\nBaseline", "noisy")
#: The filters of figure 2, in the order of the paper's table 1.
_FILTERS: Final = ("median", "nlm", "adaptive", "bilateral")
#: Rows of the paper's tables in figures 4 and 5.
_ARCHITECTURES: Final = ("Restormer", "UNet")
_DNCNN: Final = ("D7", "D20", "D64", "AR D7", "AR D20", "AR D64")
#: The row that stands for the paper's networks beside ours.
_THEIRS: Final = "D20"
#: Our shipped network.
_SHIPPED: Final = "face"


@dataclass(frozen=True)
class _Figure:
    """A figure to draw. rows: of the paper's tables, whose networks it shows."""

    name: str
    caption: str
    draw: Callable[[], Figure]
    rows: Sequence[str] = ()


def write_paper_figures(
    reproduction: Path, drawing: Callable[[str], None] = lambda _: None
) -> list[Path]:
    """Draw the figures from REPRODUCTION/data and REPRODUCTION/runs; return the written files.

    Writes REPRODUCTION/paper_figures/figure_1.png to figure_6.png, captions.md, and all of it in
    paper_figures.html. Networks are those in the folder, whatever their size; a figure without any
    of its networks is left out, and captions name missing rows. drawing: gets each figure's name.

    Raises ConfigError without a data set, DatasetError, DenoiserError, and GlsimError without
    Matplotlib.
    """
    data = reproduction / "data"
    if not data.is_dir():
        raise ConfigError(
            f"{reproduction}: has no data/ to draw: run glsim paper reproduce -o {reproduction} "
            "first"
        )
    dataset = open_dataset(data)
    runs = reproduction / "runs"
    trained = find_trained_runs(runs)[0] if any(runs.glob("*/best.pt")) else []
    groups = group_by_network(trained)
    note = data_note(dataset)
    pictures, absent = [], []
    for figure in _figures(dataset, groups, note):
        drawn = {group.row for group in groups}
        missing = [
            row for row in figure.rows if not {row, row.removeprefix(ARTEFACT_REMOVAL)} & drawn
        ]
        if figure.rows and len(missing) == len(figure.rows):
            absent.append(f"{figure.name}: no network of {', '.join(missing)} in {runs}")
            continue
        caption = f"{figure.caption} {note}"
        if missing:
            caption += f" Missing, without a checkpoint: {', '.join(missing)}."
        drawing(figure.name)
        pictures.append(CaptionedPng(figure.name, caption, to_png(figure.draw())))
    out = reproduction / FOLDER
    paths = []
    for picture in pictures:
        paths.append(out / f"{picture.name}.png")
        write_atomic(picture.png, paths[-1])
    captions = Document(
        "Figures after Kendrick, Yap and Tan",
        [[f"**{p.name}.png**: {p.caption}" for p in pictures]],
    )
    if absent:
        captions.parts += ["Left out:", absent]
    notes = [Document("Left out", [absent])] if absent else []
    page = html_page(captions.title, [], pictures, notes)
    for name, text in (("captions.md", captions.markdown()), ("paper_figures.html", page)):
        paths.append(out / name)
        write_atomic(text.encode(), paths[-1])
    return paths


def _figures(dataset: Dataset, groups: Sequence[SeedGroup], note: str) -> list[_Figure]:
    """Return the six figures; nothing is drawn yet."""
    example = choose_frame(dataset)
    of_facewarehouse = choose_frame(dataset, "facewarehouse")
    shown = source_name(of_facewarehouse.pair.record["source"])
    filters = [Column(f"{PRINTED_FILTERS[name][0]}\n", name) for name in _FILTERS]
    ours = [_own_column(group) for group in groups if group.row is None]
    beside = [
        *network_columns(groups, (_THEIRS,)),
        *ours,
        Column(f"ours, {_SHIPPED}\nshipped", _SHIPPED),
    ]

    def panels(columns: Sequence[Column], rows: Sequence[PanelRow]) -> Callable[[], Figure]:
        return lambda: _panels(example, [_NOISY, *columns], rows, note)

    maps: tuple[PanelRow, ...] = ("depth", "error", "side")
    return [
        _Figure(
            "figure_1",
            "The viewing frustum of the sensor with the head in it, camera and projector; right, "
            "what the camera sees of the head, and where the projector's light does not reach: its "
            "rays are dotted behind what stops them.",
            lambda: frustum_figure(dataset, example, note),
        ),
        _Figure(
            "figure_2",
            "The paper's filters beside the truth: depth, error, and the surface seen from 30 "
            "degrees aside. Adaptive is a filter over time, on single frames the identity.",
            panels(filters, maps),
        ),
        _Figure(
            "figure_3",
            f"A depth map in 3D, left clean, right noisy: {shown}.",
            lambda: surfaces_figure(of_facewarehouse, note),
        ),
        _Figure(
            "figure_4",
            "Restormer and UNet: depth, error, and the surface seen from 30 degrees aside.",
            panels(network_columns(groups, _ARCHITECTURES), maps),
            _ARCHITECTURES,
        ),
        _Figure(
            "figure_5",
            "DnCNN with 7, 20 and 64 layers, without and with artefact removal (AR): depth, error, "
            "and normal maps. A row with AR that was not trained is its partner's network.",
            panels(network_columns(groups, _DNCNN), ("depth", "error", "normals")),
            _DNCNN,
        ),
        _Figure(
            "figure_6",
            f"Ours in the place of theirs. The shipped network `{_SHIPPED}` is trained on other "
            "sensors and heads; the mask-aware networks are trained on the pairs of this data set, "
            f"like {_THEIRS}.",
            panels(beside, ("depth", "error", "side", "normals")),
        ),
    ]


def _own_column(group: SeedGroup) -> Column:
    """Return the column of a network that is no row of the paper, named by what tells it apart."""
    run, what = group.members[0], group.title.rpartition(", ")[2]
    return Column(f"ours, mask-aware\n{what}, {run.steps:,} steps", run.spec)


def _panels(
    frame: FigureFrame, columns: Sequence[Column], rows: Sequence[PanelRow], note: str
) -> Figure:
    return panel_figure(frame, denoise(frame, columns), rows, note)
