"""The paper's figures: panels, axes with units, shadows, missing networks, and whose heads."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.dataset import Dataset, open_dataset
from glsim.eval.paper.data_note import data_note
from glsim.eval.paper.figures import write
from glsim.eval.paper.figures.frames import Column, choose_frame, denoise, network_columns
from glsim.eval.paper.figures.frustum import _face_colours, _first_hidden, _head, frustum_figure
from glsim.eval.paper.figures.panels import panel_figure
from glsim.eval.paper.figures.solids import to_figure_axes
from glsim.eval.paper.figures.surfaces import surfaces_figure
from glsim.eval.paper.runs import find_trained_runs, group_by_network
from glsim.eval.report.figures.style import to_png
from glsim.geometry.depth_map import lit_by_marching
from tests.support import checkpoint_stand_in
from tests.support.checkpoint_stand_in import write_run
from tests.support.face_set_trees import write_tree


@pytest.fixture(scope="module")
def reproduction(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with data alone: embedded heads, and D3DFACS for one of the paper's sets."""
    folder = tmp_path_factory.mktemp("reproduction")
    root = write_tree("d3dfacs_alignments", folder)
    sources = (
        '[{kind="procedural", subjects=3, frames_per_subject=1, count=3}, '
        f'{{kind="d3dfacs", root="{root}", count=1}}]'
    )
    command = ["generate", "-o", str(folder / "data"), "--set", f"source={sources}"]
    options = ["--sensor", "kinect-v2-paper", "--crop", "96", "--split", "0,0,1", "--workers", "1"]
    assert main([*command, *options, "-q"]) == 0
    return folder


@pytest.fixture
def data(reproduction: Path) -> Dataset:
    return open_dataset(reproduction / "data")


def texts(figure: Any) -> str:
    words = [t.get_text() for axis in figure.axes for t in (axis.title, axis.xaxis.label,
             axis.yaxis.label, *axis.texts)]  # fmt: skip
    return "\n".join([*words, figure.get_supxlabel()])


def test_a_note_says_whose_heads_are_shown(data: Dataset) -> None:
    note = data_note(data)
    assert "embedded heads (3), D3DFACS (1)" in note
    assert "In place of D3DFACS (1), FaceWarehouse (1)" in note or "FaceWarehouse (1)" in note
    assert "Biwi (1): embedded heads." in note
    assert "Kendrick et al." in note


def test_figure_3_shows_the_set_that_is_asked_for(data: Dataset) -> None:
    assert choose_frame(data, "d3dfacs").pair.record["source"] == "d3dfacs"
    assert choose_frame(data, "facewarehouse").pair.record["source"] == "procedural"
    frame = choose_frame(data, "d3dfacs")
    figure: Any = surfaces_figure(frame, "note")
    assert [axis.get_title() for axis in figure.axes] == ["clean", "noisy"]
    for axis in figure.axes:
        assert axis.get_xlabel() == "x [mm]"
        assert axis.get_ylabel() == "distance [mm]"
        assert axis.get_zlabel() == "up [mm]"
        assert len(axis.collections) == 1
    assert figure.get_supxlabel() == "note"


def test_panels_have_units_and_their_own_scale(data: Dataset) -> None:
    frame = choose_frame(data)
    maps = denoise(frame, [Column("noisy\nBaseline", "noisy"), Column("Median\n", "median")])
    np.testing.assert_array_equal(maps["noisy\nBaseline"], frame.noisy)
    figure = panel_figure(frame, maps, ("depth", "error", "normals"), "a note")
    said = texts(figure)
    for words in ("truth", "Median", "Baseline", "row [px]", "x [px]", "depth [mm]",
                  "method - truth [mm]", "to camera", "a note"):  # fmt: skip
        assert words in said
    assert len(figure.axes) == 3 * 4
    titles = [axis.title.get_text() for axis in figure.axes if axis.title.get_text().strip()]
    assert len(titles) == 3  # above the first row: nothing is written over a head
    assert all(not axis.texts for axis in figure.axes[4:7])


def test_the_head_is_where_the_camera_saw_it(data: Dataset) -> None:
    """Each measured pixel lies on the mesh of figure 1, from the embedded source and from files."""
    for kind in ("procedural", "d3dfacs"):
        frame = choose_frame(data, kind)
        head = _head(data, frame)
        colours = _face_colours(head, frame)
        lit = lit_by_marching(frame.clean / np.float32(1000), frame.window)
        # The whole head has a back; the scan is a face, all of it seen.
        kinds = {tuple(colour) for colour in np.round(colours, 3)}
        assert len(kinds) == (3 if kind == "procedural" else 1)
        image = frame.window.intrinsics.project(head.vertices_mm.astype(np.float64))
        column, row = np.floor(image).astype(int).T
        inside = (column >= 0) & (column < 96) & (row >= 0) & (row < 96)
        measured = frame.clean[row[inside], column[inside]]
        off = np.abs(measured - head.vertices_mm[inside, 2])[measured > 0]
        assert np.mean(off < 5) > 0.4  # the rest is the back of the head, or a rim
        assert lit.max() == 1


def test_rays_end_at_what_stops_them(data: Dataset) -> None:
    frame = choose_frame(data)
    row, column = np.argwhere(frame.clean > 0)[len(np.argwhere(frame.clean > 0)) // 2]
    surface = frame.window.intrinsics.unproject(frame.clean)[row, column]
    ray = to_figure_axes(surface * np.linspace(0.9, 1.1, 201)[:, None])
    assert abs(_first_hidden(ray, frame) - 100) <= 1
    assert _first_hidden(ray[:90], frame) == 89
    figure = frustum_figure(data, frame, "note")
    assert [axis.get_title() for axis in figure.axes] == [
        "viewing frustum", "the head, and the projector's shadow on it",
    ]  # fmt: skip
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "frustum, 512x424 px" in labels
    assert "crop, 96x96 px" in labels
    assert "projector, 75 mm beside; its rays" in labels


@pytest.mark.long
def test_networks_of_a_folder_and_what_is_missing(
    reproduction: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "glsim.denoise.inference", checkpoint_stand_in)
    runs = tmp_path / "runs"
    write_run(runs / "d7-small", 0.1, row="D7", title="small", size="small")
    write_run(runs / "d7-full", 0.2, row="D7", title="full", size="full")
    write_run(runs / "ours", 0.3, row=None, title="U-Net, blind", size="own", soft=True)
    write_run(runs / "more", 0.4, row=None, title="U-Net, again", size="own", soft=True)
    groups = group_by_network(find_trained_runs(runs)[0])
    columns = network_columns(groups, ("D7", "D20"))
    assert [column.title.partition(",")[0] for column in columns] == ["D7\nfull"]

    (tmp_path / "data").symlink_to(reproduction / "data")
    drawn: dict[str, list[str]] = {}

    def small(frame: Any, maps: Any, rows: Any, note: str) -> Any:
        figure = panel_figure(frame, maps, ("depth",), note)
        drawn[note + str(len(drawn))] = [*maps]
        return figure

    monkeypatch.setattr(write, "panel_figure", small)
    monkeypatch.setattr(write, "to_png", lambda figure: to_png(figure, dpi=20))
    monkeypatch.setattr(write, "frustum_figure", lambda *_: surfaces_figure(*_[1:]))
    paths = write.write_paper_figures(tmp_path)
    names = {path.name for path in paths}
    assert names == {*(f"figure_{n}.png" for n in (1, 2, 3, 5, 6)), "captions.md",
                     "paper_figures.html"}  # fmt: skip
    assert all(cv2.imread(str(path)) is not None for path in paths if path.suffix == ".png")
    assert [[title.partition("\n")[0] for title in titles] for titles in drawn.values()] == [
        ["noisy", "Median", "NLM", "Adaptive", "Bilateral"],
        ["noisy", "D7"],
        ["noisy", "ours, mask-aware", "ours, mask-aware", "ours, face"],
    ]
    # Networks of the same size are told apart by their titles.
    last = list(drawn.values())[-1]
    assert {title.partition("\n")[2] for title in last[1:3]} == {
        "blind, 10 steps",
        "again, 10 steps",
    }
    text = (tmp_path / "paper_figures" / "captions.md").read_text()
    assert "Missing, without a checkpoint: D20, D64, AR D20, AR D64." in text
    assert "figure_4: no network of Restormer, UNet" in text
    assert text.count("embedded heads") >= 5


def test_without_data_there_is_nothing_to_draw(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["reproduce", "-o", str(tmp_path), "--figures"]) == 2
    assert f"run glsim paper reproduce -o {tmp_path} first" in capsys.readouterr().err
