"""The command line as a user meets it, in an empty folder, with wrong arguments too."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.core.files.png import stated_unit_mm
from glsim.data.verification import verify
from glsim.sensors.sensor import SENSOR_FOLDER, load_sensor
from glsim.simulation.frame import LAYERS
from tests.support.people import needs_anny
from tests.support.scenes import face_mesh, write_obj


@pytest.fixture
def face_file(here: Path) -> Path:
    write_obj(here / "face.obj", face_mesh())
    return here / "face.obj"


def run(*arguments: str) -> int:
    return main(list(arguments))


def fails(capsys: pytest.CaptureFixture[str], status: int, *arguments: str) -> str:
    """The one line of an error, with the right exit status."""
    assert run(*arguments) == status
    lines = [line for line in capsys.readouterr().err.splitlines() if "error" in line.lower()]
    assert len(lines) == 1, lines
    assert "Traceback" not in lines[0]
    return lines[0]


def test_render_writes_five_files(
    face_file: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["render", str(face_file), "-o", "out", "--axes", "+x+y+z", "--unit", "mm"]
    command += ["--sensor", "kinect-v2-fankhauser"]
    assert run(*command, "--seed", "3", "--set", "axial.base_sigma_mm=2.5") == 0
    assert capsys.readouterr().err.count("face_clean.png") == 1, "one mesh, one frame"
    assert len(list((here / "out").iterdir())) == 5
    for layer in LAYERS:
        image = cv2.imread(str(here / "out" / f"face_{layer}.png"), cv2.IMREAD_UNCHANGED)
        assert image.shape == (424, 512)
        assert image.dtype == (np.uint8 if layer == "reason" else np.uint16)
    assert (here / "out" / "face_preview.png").is_file()
    before = (here / "out" / "face_noisy.png").read_bytes()
    assert run(*command, "--seed", "3", "--set", "axial.base_sigma_mm=2.5") == 0
    assert (here / "out" / "face_noisy.png").read_bytes() == before
    assert run(*command, "--seed", "4", "--set", "axial.base_sigma_mm=2.5") == 0
    assert (here / "out" / "face_noisy.png").read_bytes() != before
    assert run(*command, "--depth-unit-mm", "0.25") == 0
    stated = [stated_unit_mm(here / "out" / f"face_{n}.png") for n in ("clean", "infrared")]
    assert stated == [0.25, None]


def test_generate_preview_and_corrupt_go_together(here: Path) -> None:
    command = ["generate", "-o", "data", "--subjects", "3", "--frames-per-subject", "2"]
    command += ["--set", "output.crop=96", "--set", "split=0.34,0.33,0.33", "--workers", "1", "-q"]
    assert run(*command) == 0
    assert run(*command) == 0, "a finished run is checked and left"
    assert verify(here / "data", deep=True) == []
    assert {p.name for p in (here / "data").iterdir() if p.is_dir()} >= {"train", "val", "test"}
    assert run("preview", "data", "-o", "seen", "--frames", "2", "-q") == 0
    sheet = cv2.imread(str(here / "seen" / "contact_sheet.png"))
    assert sheet.shape[1] == 1200
    summary = (here / "seen" / "summary.md").read_text()
    inside, rims = (float(rms) for rms in re.findall(r"mean \S+ mm, rms (\S+) mm", summary))
    assert inside < rims
    clean = next((here / "data" / "train").rglob("*_clean.png"))
    for backend in ("egl", "numpy"):
        target = here / f"{backend}.png"
        assert run("corrupt", str(clean), "-o", str(target), "--backend", backend, "-q") == 0
        noisy = cv2.imread(str(target), cv2.IMREAD_UNCHANGED)
        truth = cv2.imread(str(clean), cv2.IMREAD_UNCHANGED)
        both = (noisy > 0) & (truth > 0)
        assert both.mean() > 0.5 * (truth > 0).mean()
        assert 0.5 < (noisy.astype(float) - truth)[both].std() < 20


def test_a_folder_of_nothing_but_bad_meshes_is_refused_before_the_run(
    here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "scans").mkdir()
    (here / "scans" / "noise.stl").write_bytes(bytes(range(256)) * 3)
    arguments = ["generate", "-o", "data", "--source", "folder", "--root", "scans"]
    said = fails(capsys, 1, *arguments, "--workers", "1")
    assert "scans: no mesh in it can be used" in said
    assert said.count("noise.stl") == 1, "said once"
    assert not (here / "data").exists()


def test_a_shader_that_does_not_compile_is_named_with_its_line(
    face_file: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "mine.glsl").write_text(
        "#version 330 core\n// mine\nuniform sampler2D u_depth;\nout float depth;\n"
        "void main() {\n    depth = oops;\n}\n"
    )
    (here / "mine.toml").write_text(
        'title = "mine"\n[rig]\nwidth = 64\nheight = 48\nfocal_px = [45, 45]\n'
        'centre_px = [32, 24]\n[[stage]]\nuse = "mine.glsl"\n'
    )
    arguments = ["render", "face.obj", "--sensor", "mine.toml", "--axes", "+x+y+z", "--unit", "mm"]
    assert "mine.glsl:6:" in fails(capsys, 1, *arguments)


@pytest.mark.parametrize(
    ("line", "text"),
    [
        ("uniform sampler2D u_dpeth;", "reads the layer 'dpeth', which no stage of glsim writes"),
        ("uniform uint u_sede;", "glsim binds no uniform 'u_sede' (did you mean 'u_seed'"),
    ],
)
def test_a_misspelt_name_in_a_stage_is_said(
    line: str, text: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = (
        f"#version 330 core\n// mine\n{line}\nout float depth;\nvoid main() {{ depth = 1.0; }}\n"
    )
    (here / "mine.glsl").write_text(source)
    error = fails(capsys, 2, "stages", "mine.glsl")
    assert text in error
    assert "did you mean" in error
    (here / "mine.glsl").write_text(source.replace("dpeth", "infrared").replace("sede", "seed"))
    assert run("stages", "mine.glsl") == 0


def test_tables_list_what_there_is(capsys: pytest.CaptureFixture[str]) -> None:
    for command, words in (
        (["sensors"], "kinect-v2-paper"),
        (["stages"], "white Gaussian noise"),
        (["stages", "axial"], "noise/axial.glsl:"),
        (["info"], "osmesa"),
        (["eval", "--list"], "median: Median over a square"),
        (["train", "--list"], "paper-d7-small: DnCNN D7"),
    ):
        assert run(*command) == 0
        assert words in capsys.readouterr().out


def test_a_sensor_is_printed_and_copied(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shipped = (SENSOR_FOLDER / "kinect-v1.toml").read_text()
    assert run("sensors", "kinect-v1") == 0
    assert capsys.readouterr().out == shipped
    mine = tmp_path / "mine.toml"
    assert run("sensors", "kinect-v1", "-o", str(mine)) == 0
    assert (
        mine.read_text().replace("copy of kinect-v1: ", "").replace("# sheet", "sheet") == shipped
    )
    assert "copy of kinect-v1: Kinect V1" in load_sensor(str(mine)).title
    assert not load_sensor(str(mine)).sheet
    assert load_sensor(str(mine)).stages == load_sensor("kinect-v1").stages
    capsys.readouterr()
    for words, message in (
        (("kinect-v1", "-o", str(mine)), "is there already"),
        (("kinect-v1", "-o", str(tmp_path / "mine.txt")), "give a name that ends in .toml"),
        (("-o", str(tmp_path / "new.toml")), "name the sensor to copy"),
        (("kinect-v9",), "no such sensor 'kinect-v9'"),
    ):
        assert run("sensors", *words) in (1, 2)
        assert message in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == ["mine.toml"]


@needs_anny
def test_people_are_a_source_with_a_framing(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    common = ["generate", "--source", "people", "--subjects", "3", "--frames-per-subject", "1"]
    made = [*common, "-o", "data", "--set", "source.framing=body"]
    more = ["output.layers=clean,noisy,regions", "pose.distance_mm=3000"]
    assert run(*made, *(word for text in more for word in ("--set", text)), "--workers", "1") == 0
    assert verify(here / "data") == []
    records = (here / "data" / "manifest.jsonl").read_text()
    assert records.replace(" ", "").count('"framing":"body"') == 3
    wrong = fails(capsys, 2, *common, "-o", "data2", "--set", "source.framing=feet")
    assert "framing" in wrong


def test_people_without_anny_say_what_to_install(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GLSIM_CACHE", str(here / "cache"))
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    line = fails(capsys, 2, "generate", "-o", "data", "--source", "people")
    assert "run glsim fetch people" in line
