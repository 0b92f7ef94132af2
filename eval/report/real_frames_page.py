"""The scores on a real recording as a document, JSON, and an HTML page with figures."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from glsim.core.errors import counted
from glsim.core.files.atomic import json_text, write_atomic
from glsim.eval.real_frames.frame_truth import BINS_M
from glsim.eval.real_frames.totals import EDGES, Interval, RealMeasures, RealScores
from glsim.eval.report.document import TEXTS, CaptionedPng, Document, Heading, TextTable, html_page
from glsim.eval.report.score_tables import format_number

_TEXTS: Final = TEXTS["real_frames"]
_EDGE_HEADS: Final[dict[str, tuple[str, float]]] = _TEXTS["edge_columns"]


def real_frames_document(scores: RealScores, remarks: Sequence[str] = ()) -> Document:
    """Return the tables of all measures, with a description of the recording."""
    distances = [f"{near:g}-{far:g} m" for near, far in pairwise(BINS_M)]
    scenes = counted(scores.scenes, "static scene")
    units = scenes if scores.by_scene else "tiles of 64 x 64 px"
    first, second = scores.own_ring_losses
    own = _TEXTS["own_losses"].format(first=100 * first, second=100 * second)
    own = "" if math.isnan(first) else own
    page = Document(f"{scores.title}: {scores.kind}")
    page.parts += [
        _TEXTS["head"].format(
            frames=counted(len(scores.checksums), "frame"),
            identity=scores.identity,
            static=scores.static_frames,
            scenes=scenes,
            boards=scores.boards,
        )
    ]
    if scores.static_frames:
        page.parts += [
            Heading("Static pairs, RMSE [mm]"),
            _TEXTS["static"].format(bins=BINS_M, pixels=str(scores.pixels)[1:-1], units=units),
            _table(scores, distances, lambda m: m.pair_rmse_mm, lambda m: m.pair_change),
        ]
    page.parts += [
        Heading("Planes: RMSE from the plane fitted to a tile [mm]"),
        _TEXTS["planes"],
        _table(scores, distances, lambda m: m.plane_rmse_mm, lambda m: m.plane_change),
    ]
    if scores.boards:
        page.parts += [
            Heading("Chessboard, paper: RMSE from its plane [mm]"),
            _TEXTS["boards"],
            _table(scores, distances, lambda m: m.paper_rmse_mm, lambda m: m.paper_change),
        ]
    page.parts += [
        Heading("Smooth surfaces: shift against the raw frames [mm]"),
        _TEXTS["shifts"],
        _table(scores, [*distances, "largest"], lambda m: (*m.shift_mm, m.largest_shift_mm)),
        Heading("Edges"),
        _TEXTS["edges"] + own,
        _table(
            scores,
            [heading for heading, _ in _EDGE_HEADS.values()],
            lambda m: [_EDGE_HEADS[name][1] * m.edges[name] for name in EDGES],
        ),
    ]
    if remarks:
        page.parts += [Heading("Remarks"), list(remarks)]
    return page


def _table(
    scores: RealScores,
    heads: Sequence[str],
    values: Callable[[RealMeasures], Sequence[float]],
    change: Callable[[RealMeasures], Interval] | None = None,
) -> TextTable:
    """Return a row per method, without empty columns; with ``change``, the smallest is bold."""
    rows = np.array([values(measures) for measures in scores.methods.values()])
    used = ~np.isnan(rows).all(axis=0)
    cells = [[format_number(value) for value in row] for row in rows[:, used]]
    if change is not None:
        least = [format_number(value) for value in np.nanmin(rows[:, used], axis=0)]
        cells = [
            [f"**{text}**" if text == best else text for text, best in zip(row, least, strict=True)]
            + [_interval(change(measures))]
            for row, measures in zip(cells, scores.methods.values(), strict=True)
        ]
    head = ["method", *np.array(heads)[used].tolist(), *(["change [%]"] if change else [])]
    return TextTable(head, [[f"`{n}`", *row] for n, row in zip(scores.methods, cells, strict=True)])


def _interval(change: Interval) -> str:
    if math.isnan(change.value):
        return "n/a"
    text = f"{change.value:+.0f}"
    return text if math.isnan(change.low) else f"{text} [{change.low:+.0f}, {change.high:+.0f}]"


def write_real_frames(
    scores: RealScores,
    out: Path,
    pictures: Sequence[CaptionedPng] = (),
    remarks: Sequence[str] = (),
) -> list[Path]:
    """Write table.md and scores.json; with pictures, report.html and figures/*.png.

    Returns the paths. Raises DatasetError if writing fails.
    """
    page = real_frames_document(scores, remarks)
    paths = [out / "table.md", out / "scores.json"]
    write_atomic(page.markdown().encode(), paths[0])
    write_atomic(json_text(scores.as_json()), paths[1])
    if pictures:
        for picture in pictures:
            write_atomic(picture.png, out / "figures" / f"{picture.name}.png")
        paths.append(out / "report.html")
        write_atomic(html_page(f"Denoisers on {scores.kind}", [page], pictures).encode(), paths[-1])
    return paths
