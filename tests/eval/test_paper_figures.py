"""The paper's figures: panels, axes with units, shadows, missing networks, and whose heads."""

import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.data.reader import Dataset, open_dataset
from glsim.eval.paper.data_note import run_note
from glsim.eval.paper.figures import draw_figures as write
from glsim.eval.paper.figures.solids import choose_frame, frustum_figure, rig_of, surfaces_figure
from glsim.eval.report.figures.panels import method_panels
from glsim.eval.report.figures.style import to_png
from tests.support import checkpoint_stand_in
from tests.support.checkpoint_stand_in import write_run
from tests.support.face_sets import write_tree


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
    options = ["--sensor", "kinect-v2-paper", "--set", "output.crop=96", "--set", "split=0,0,1"]
    options += ["--workers", "1"]
    assert main([*command, *options, "-q"]) == 0
    return folder


@pytest.fixture
def data(reproduction: Path) -> Dataset:
    return open_dataset(reproduction / "data")


def test_a_note_says_whose_heads_are_shown(data: Dataset) -> None:
    note = run_note(data.path)
    assert note.startswith("test: 4 images of 4 people. Faces: embedded heads (3), D3DFACS (1).")
    assert "Biwi (1): embedded heads. Sensor: Kendrick et al." in note


def test_figure_3_shows_the_set_that_is_asked_for(data: Dataset) -> None:
    assert choose_frame(data, "d3dfacs").record["source"] == "d3dfacs"
    assert choose_frame(data, "facewarehouse").record["source"] == "procedural"
    frame = choose_frame(data, "d3dfacs")
    figure: Any = surfaces_figure(frame, "note")
    assert [axis.get_title() for axis in figure.axes] == ["clean", "noisy"]
    assert [len(axis.collections) for axis in figure.axes] == [1, 1]


def test_figure_1_shows_the_frustum_and_the_shadow(data: Dataset) -> None:
    figure = frustum_figure(choose_frame(data, "procedural"), rig_of(data), "note")
    whole, near = figure.axes
    assert whole.get_title() == "viewing frustum"
    colours = np.unique(np.round(near.collections[0].get_facecolor()[:, :3], 2), axis=0)
    assert len(colours) > 20  # shaded
    red_over_green = colours[:, 0] / colours[:, 1]
    assert red_over_green.min() < 2 < 4 < red_over_green.max()  # lit skin, and shadow
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert {"frustum, 512x424 px", "crop, 96x96 px"} <= {*labels}
    assert "projector, 75 mm beside" in labels


@pytest.mark.long
def test_networks_of_a_folder_and_what_is_missing(
    reproduction: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "glsim.denoise.inference", checkpoint_stand_in)
    runs = tmp_path / "runs"
    write_run(runs / "d7-small", 0.1, row="D7", title="small", size="small")
    write_run(runs / "d7-full", 0.2, row="D7", title="full", size="full")
    write_run(runs / "ours", 0.3, row=None, title="U-Net, blind", size="own", soft=True)
    (tmp_path / "data").symlink_to(reproduction / "data")
    drawn: list[list[str]] = []

    def small(frame: Any, maps: Any, rows: Any, note: str) -> Any:
        drawn.append([*maps])
        return method_panels(frame, maps, ("depth",), note)

    monkeypatch.setattr(write, "method_panels", small)
    monkeypatch.setattr(write, "to_png", lambda figure: to_png(figure, dpi=20))
    paths = write.write_paper_figures(tmp_path)
    assert {path.name for path in paths} == {
        *(f"figure_{n}.png" for n in (1, 2, 3, 5, 6)), "captions.md", "paper_figures.html",
    }  # fmt: skip
    assert all(cv2.imread(str(path)) is not None for path in paths if path.suffix == ".png")
    assert [[title.partition("\n")[0] for title in titles] for titles in drawn] == [
        ["noisy", "Median", "NLM", "Bilateral"],
        ["noisy", "D7"],
        ["noisy", "ours, blind", "ours, face"],
    ]
    assert drawn[1][1] == "D7\nfull, 10 steps"
    text = (tmp_path / "paper_figures" / "captions.md").read_text()
    assert "Missing, without a checkpoint: D20, D64." in text
    assert text.count("embedded heads") >= 5
    assert text.count("3 trainings (seeds 0) of 10 steps, 0.075 h.") >= 5
