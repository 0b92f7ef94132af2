"""Test inspecting face sets, and estimating a data set with --plan."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import ConfigError
from glsim.core.files.png import encode_png
from glsim.data.inspection import inspect, open_faces, recognise
from glsim.data.maps import open_maps
from tests.support.face_models import write_face_x_model
from tests.support.face_sets import (
    FACE,
    OTHERS,
    TRIANGLES,
    needs_others,
    obj_bytes,
    ply_bytes,
    put,
    write_recording,
    write_tester,
)


def _d3dfacs(root: Path) -> Path:
    for frame in range(3):
        put(root / f"Joe/1+2/1+2_{frame}.ply", ply_bytes(FACE / 1000, TRIANGLES))
    return root


def test_formats_are_recognised(tmp_path: Path) -> None:
    write_tester(tmp_path / "fw/deeper")
    write_recording(tmp_path / "biwi/hpdb")
    write_face_x_model(tmp_path / "ict")
    _d3dfacs(tmp_path / "d3/d3dfacs_alignments")
    put(tmp_path / "any/ann/smile/1.obj", obj_bytes(FACE, TRIANGLES))
    put(tmp_path / "data/dataset.json", b"{}")
    kinds = {"fw": "facewarehouse", "biwi": "biwi", "ict": "ict-facekit", "d3": "d3dfacs"}
    for name, kind in (kinds | {"any": "folder"}).items():
        assert recognise(tmp_path / name) == kind
    with pytest.raises(ConfigError, match="look at it with glsim preview"):
        recognise(tmp_path / "data")
    with pytest.raises(ConfigError, match="there is no such folder"):
        recognise(tmp_path / "nowhere")


def test_what_is_there_is_counted_and_problems_are_named(tmp_path: Path) -> None:
    _d3dfacs(tmp_path)
    put(tmp_path / "Joe/1+2/1+2_9.ply", b"ply\n")
    kind, source = open_faces(tmp_path)
    report = inspect(tmp_path, kind, source, 40)
    assert report.people == {"Joe": (1, 4)}
    assert (report.frames, report.checked) == (4, 4)
    assert report.vertices == (len(FACE), len(FACE))
    assert report.triangles == (len(TRIANGLES), len(TRIANGLES))
    assert report.placements == {"unit m, axes +x+y+z, 215 mm across": 3}
    (problem,) = report.problems
    assert problem.startswith("Joe/1+2/1+2_9.ply: damaged")
    assert inspect(tmp_path, kind, source, 2).checked == 2


def test_the_command_prints_and_draws(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "look.png"
    write_tester(tmp_path / "set")
    assert main(["inspect", str(tmp_path / "set"), "-o", str(out), "--shown", "5"]) == 0
    printed = capsys.readouterr().out
    assert "facewarehouse, 1 person, 2 sequences, 50 frames" in printed
    assert "found" not in printed.split("axes +x+y+z")[1].splitlines()[0]
    assert "no problems" in printed
    picture = cv2.imread(str(out))
    assert picture.shape == (40 + 2 * 260, 4 * 240, 3)  # names above the pictures
    mesh = put(tmp_path / "one.obj", obj_bytes(FACE, TRIANGLES))
    assert main(["inspect", str(mesh), "-o", str(out)]) == 0
    assert "mesh, 1 person, 1 sequence, 1 frame" in capsys.readouterr().out
    (tmp_path / "folder").mkdir()
    for folder in ("folder", "new"):
        assert main(["inspect", str(mesh), "-o", str(tmp_path / folder), "-q"]) == 0
        assert (tmp_path / folder / "inspect.png").is_file()


def test_the_command_fails_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(tmp_path / "Joe/1/1_1.ply", b"ply\n")
    assert main(["inspect", str(tmp_path), "-o", str(tmp_path / "a.png")]) == 1
    assert "none of 1 frame can be used" in capsys.readouterr().err
    assert main(["inspect", str(tmp_path), "-o", "a.jpg"]) == 2
    assert main(["inspect", str(tmp_path / "nowhere")]) == 2


@needs_others
@pytest.mark.long
@pytest.mark.parametrize("name", ["d3dfacs_alignments", "FaceWarehouse", "hpdb"])
def test_whole_trees(name: str, tmp_path: Path) -> None:
    path = str(OTHERS / name)
    assert main(["inspect", path, "-o", str(tmp_path / "look.png"), "-q"]) == 0


def test_a_plan_writes_nothing_and_counts_everything(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(1, 5):
        write_tester(tmp_path / "fw", number, poses=1)
    put(tmp_path / "fw/Tester_1/Blendshape/shape.bs", b"")  # damaged: a plan reads no mesh
    root = ["--source", "facewarehouse", "--root", str(tmp_path / "fw"), "--set", "split=paper"]
    assert main(["generate", "--plan", *root, "-o", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out
    assert not (tmp_path / "out").exists()
    assert "192 images" in printed
    assert "nothing was written" in " ".join(printed.split())
    assert main(["generate", *root]) == 2
    assert "give -o DIR" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("size", "lattice", "sensor", "focal"),
    [
        ((424, 512), False, "kinect-v2", 365),
        ((576, 640), False, "azure-kinect", 504),
        ((480, 640), True, "realsense-d435", 390),
        ((240, 320), True, "realsense-d435", 195),  # decimated
        ((480, 640), False, None, 365),
    ],
)
def test_a_recording_names_its_camera_and_denoiser(
    here: Path, capsys: pytest.CaptureFixture[str],
    size: tuple[int, int], lattice: bool, sensor: str | None, focal: int
) -> None:  # fmt: skip
    depth = np.linspace(600, 3000, size[0] * size[1]).reshape(size)
    if lattice:  # 1/32 px of disparity
        depth = np.rint(626813 / np.rint(626813 / depth))
    put(Path("frames/a.png"), encode_png(depth.astype(np.uint16)))
    assert open_maps(Path("frames")).assumed == (sensor or "kinect-v2")
    assert main(["inspect", "frames"]) == 0
    printed = capsys.readouterr().out
    assert (f"like {sensor}" if sensor else "not recognised") in printed
    assert f"glsim denoise frames -o denoised -d face{'-stereo' * lattice}\n" in printed
    assert f"; f {focal} px (assumed)\n" in printed
    assert main(["inspect", "frames", "--depth-unit-mm", "0.5"]) == 0
    assert " --depth-unit-mm 0.5\n" in capsys.readouterr().out
    assert [path.name for path in here.iterdir()] == ["frames"], "a picture only with -o"
