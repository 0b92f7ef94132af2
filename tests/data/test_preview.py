"""Test that pictures of a data set say only what the data set knows."""

import base64
import json
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from glsim import open_dataset
from glsim.cli import main
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import DepthFrame, FrameKey
from glsim.core.reason import Reason
from glsim.data import contact_sheet as preview
from glsim.faces.meshes.load import load_mesh
from glsim.faces.sources.procedural import ProceduralFaces
from tests.support.imports import ROOT


@pytest.mark.parametrize("layers", ["clean,noisy", "clean,noisy,reason"])
def test_a_lost_pixel_of_a_set_without_reasons_is_unknown(
    here: Path, monkeypatch: pytest.MonkeyPatch, layers: str
) -> None:
    command = ["generate", "-o", "data", "--subjects", "1", "--frames-per-subject", "2", "-q"]
    command += ["--set", f"output.layers={layers}", "--set", "output.crop=96", "--workers", "1"]
    command += ["--set", "split=1,0,0"]
    assert main([*command, "--sensor", "kinect-v1"]) == 0
    written: list[str] = []
    write = preview._write

    def record(picture: preview.Picture, text: str, at: tuple[int, int], size: float) -> None:
        written.append(text)
        write(picture, text, at, size)

    monkeypatch.setattr(preview, "_write", record)
    assert main(["preview", "data", "-o", "seen", "--3d", "-q"]) == 0
    page = Path("seen/surface.html").read_text()
    maps = json.loads(re.findall(r"const maps = (.*?);", page)[0])
    assert [m[0] for m in maps] == ["clean", "noisy"]
    shown = np.frombuffer(base64.b64decode(maps[1][3]), "<f4").reshape(96, 96)
    np.testing.assert_array_equal(shown, open_dataset("data").frames()[1].noisy_mm)
    unknown = "lost, reason unknown: the data set has no layer reason"
    at_random = f"{int(Reason.DROPPED)} dropped: {Reason.DROPPED.help}"
    assert (unknown in written) == ("reason" not in layers)
    assert at_random not in written or "reason" in layers


@pytest.mark.parametrize(
    ("frames", "rows", "columns", "side"), [(4, 4, 1, 300), (5, 3, 2, 200), (12, 4, 3, 200)]
)
def test_more_than_four_frames_stand_in_columns(
    frames: int, rows: int, columns: int, side: int
) -> None:
    """Down, then to the right; the numbers of the captions tell the order."""
    depth_mm = np.full((20, 20), 900, np.float32)
    camera = Intrinsics(20, 20, 30.0, 30.0, 10.0, 10.0)
    layers = {"clean_mm": depth_mm, "noisy_mm": depth_mm}
    shown = [DepthFrame(FrameKey("", "a", n), camera, layers) for n in range(frames)]
    sheet = preview.contact_sheet(shown, "title")
    assert sheet.shape[1] == columns * 4 * side
    assert sheet.shape[0] > 66 + rows * side
    whole = preview.frame_row(shown[rows % frames], side)
    top, left = (66, 4 * side) if columns > 1 else (66, 0)
    expected = whole if columns > 1 else preview.frame_row(shown[0], side)
    height = side + 20  # the name stands above the cells
    np.testing.assert_array_equal(sheet[top : top + height, left : left + 4 * side], expected)
    other = DepthFrame(FrameKey("other", "b", 9), camera, layers)
    np.testing.assert_array_equal(preview.frame_row(other, side)[20:], whole[20:])
    assert (preview.frame_row(other, side)[:20] != whole[:20]).any()


@pytest.mark.long
def test_people_of_the_demo_are_dressed(tmp_path: Path) -> None:
    """At least two thirds of them have hair and clothes; the script's own command, fewer frames."""
    script = (ROOT / "scripts" / "demo.sh").read_text(encoding="utf-8").replace("\\\n", " ")
    line = next(line for line in script.splitlines() if " generate " in line)
    words = shlex.split(line)[1:]
    fewer = {"--frames-per-subject": "1", "--set": "output.crop=32", "-o": str(tmp_path / "d")}
    for option, value in fewer.items():
        words[words.index(option) + 1] = value
    assert main([*words, "--workers", "1", "-q"]) == 0
    notes = [pair.record["notes"] for pair in open_dataset(tmp_path / "d")]
    hairy = [n for n in notes if n.get("appearance.hair", "shaven") not in ("shaven", "bald")]
    assert len(notes) == 12
    assert len([n for n in hairy if n.get("appearance.cloth")]) >= 8


def test_a_head_is_shown_without_a_data_set(here: Path) -> None:
    assert main(["preview", "--3d", "--mesh", "--frames", "1", "-q"]) == 0
    written = {path.name for path in here.iterdir()}
    assert written == {"contact_sheet.png", "summary.md", "surface.html", "face.obj"}
    assert main(["preview", "data", "--mesh"]) == 2
    loaded = load_mesh(Path("face.obj"))
    assert "unit mm, axes +x+y+z" in str(loaded.alignment)
    head, triangles = ProceduralFaces().neutral("p0000")
    span_mm = np.ptp(head[np.unique(triangles)], axis=0)
    np.testing.assert_allclose(np.ptp(loaded.mesh.vertices_mm, axis=0), span_mm, atol=0.01)
    assert "an embedded head, kinect-v2" in Path("summary.md").read_text()
