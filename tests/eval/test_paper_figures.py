"""The paper's figures: panels, missing networks, and whose heads."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import cv2
import pytest

from glsim.cli import main
from glsim.data.reader import open_dataset
from glsim.eval.paper import draw_figures as write
from glsim.eval.paper.trained_networks import data_note
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


def test_a_note_says_whose_heads_are_shown(reproduction: Path) -> None:
    note = data_note(open_dataset(reproduction / "data"))
    assert "embedded heads (3), D3DFACS (1)" in note
    assert "In place of D3DFACS (1), FaceWarehouse (1)" in note or "FaceWarehouse (1)" in note
    assert "Biwi (1): embedded heads." in note
    assert "Kendrick et al." in note


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
        *(f"figure_{n}.png" for n in (2, 5, 6)), "captions.md", "paper_figures.html",
    }  # fmt: skip
    assert all(cv2.imread(str(path)) is not None for path in paths if path.suffix == ".png")
    assert [[title.partition("\n")[0] for title in titles] for titles in drawn] == [
        ["noisy", "Median", "NLM", "Adaptive", "Bilateral"],
        ["noisy", "D7", "AR D7"],
        ["noisy", "ours, mask-aware", "ours, face"],
    ]
    assert drawn[1][1] == "D7\nfull, 10 steps"
    text = (tmp_path / "paper_figures" / "captions.md").read_text()
    assert "Missing, without a checkpoint: D20, D64, AR D20, AR D64." in text
    assert text.count("embedded heads") >= 3


def test_without_data_there_is_nothing_to_draw(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["paper", "figures", str(tmp_path)]) == 2
    assert f"run glsim paper reproduce -o {tmp_path} first" in capsys.readouterr().err
