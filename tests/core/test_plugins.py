"""A package of another laboratory adds one thing of each kind, used from the command line."""

import csv
import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from tests.support.imports import ROOT

PACKAGE = Path(__file__).parents[1] / "plugin_package"
GENERATE = (
    "generate", "-o", "data", "--source", "clay", "--set", "source.radius_mm=60", "--sensor",
    "lab-cam", "--subjects", "4", "--frames-per-subject", "2", "--set", "split=0,0,1",
)  # fmt: skip


def distribution(folder: Path, name: str, groups: dict[str, dict[str, str]]) -> None:
    """Write what an installer writes: the metadata by which Python finds entry points."""
    info = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [
        line
        for group, entries in groups.items()
        for line in (f"[{group}]", *(f"{key} = {value}" for key, value in entries.items()))
    ]
    (info / "entry_points.txt").write_text("\n".join(lines) + "\n")


@pytest.fixture
def lab(tmp_path: Path) -> Path:
    """A folder with the package as it is when installed."""
    project = tomllib.loads((PACKAGE / "pyproject.toml").read_text())["project"]
    shutil.copytree(PACKAGE / "lab_extras", tmp_path / "lab_extras")
    distribution(tmp_path, project["name"], project["entry-points"])
    return tmp_path


def glsim_in(
    folder: Path, *arguments: str, python: str = sys.executable
) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [python, "-m", "glsim", *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(folder), str(ROOT)])},
        capture_output=True,
        text=True,
        check=False,
    )


def output_of(folder: Path, *arguments: str) -> str:
    done = glsim_in(folder, *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.long
def test_one_thing_of_each_kind_from_the_command_line(lab: Path) -> None:
    assert "the camera of another laboratory" in output_of(lab, "sensors")
    assert "speckle" in output_of(lab, "stages")
    assert "half the difference" in output_of(lab, "stages", "ripple")
    assert "nearest: Every pixel gets" in output_of(lab, "eval", "--list")

    output_of(lab, *GENERATE, "--workers", "2")
    header = json.loads((lab / "data" / "dataset.json").read_text())
    assert header["settings"]["source"][0]["radius_mm"] == 60
    assert [stage["use"] for stage in header["sensor"]["stages"]] == [
        "ripple", "millimetre_quantise", "speckle",
    ]  # fmt: skip

    output_of(lab, "export", "data", "-o", "out", "--to", "counts")
    counts = [int(file.read_text()) for file in (lab / "out").rglob("*_count.txt")]
    assert len(counts) == 8
    assert min(counts) > 100

    output_of(lab, "eval", "data", "-o", "scores", "-d", "nearest:add_mm=3", "-d", "noisy")
    (rows,) = (lab / "scores").rglob("rows.csv")
    with rows.open() as file:
        worst = [float(row["worst_mm"]) for row in csv.DictReader(file) if row["method"] == "noisy"]
    assert worst == pytest.approx([20] * 8, abs=1)  # the ripple's amplitude
    (table,) = (lab / "scores").rglob("table.md")
    assert "worst_mm [mm]" in table.read_text()

    done = glsim_in(lab, "validate", "lab-cam", "--frames", "8")
    assert "ripple on a wall" in done.stdout, done.stderr
    assert "lab-cam: 1 checks: 1 pass" in done.stderr


@pytest.mark.long
def test_a_data_set_is_not_resumed_with_other_code_of_a_package(lab: Path) -> None:
    output_of(lab, *GENERATE)
    output_of(lab, *GENERATE)
    inputs = json.loads((lab / "data" / "dataset.json").read_text())["inputs"]
    assert {"lab_extras/speckle.py", "lab_extras/ripple.glsl"} <= inputs["stages"].keys()
    code = lab / "lab_extras" / "clay.py"
    code.write_text(code.read_text().replace("0.9, 1.1", "0.8, 1.2"))
    done = glsim_in(lab, *GENERATE)
    assert done.returncode == 2
    assert "lab_extras/clay.py was changed since data was begun" in done.stderr


def test_settings_of_a_packages_source_are_checked_as_any(lab: Path) -> None:
    for setting, message in (
        ("source.radius_mm=1", "source.radius_mm: must be greater than or equal to 20"),
        ("source.radius=1", "no such setting 'source.radius' (did you mean 'source.radius_mm'?)"),
        ("source.peak_only=true", "peak_only: clay has no such option (d3dfacs)"),
    ):
        done = glsim_in(lab, "generate", "--plan", "--source", "clay", "--set", setting)
        assert done.returncode == 2
        assert message in done.stderr
    done = glsim_in(lab, "generate", "--plan", "--source", "clai")
    assert "'clai' is not one of biwi, board, clay" in done.stderr


@pytest.mark.parametrize(
    ("group", "entry", "arguments", "message"),
    [
        ("glsim.sources", {"c": "lab_extras.nothing:X"}, ("generate", "--plan", "--source", "c"),
         "lab_extras.nothing:X cannot be loaded (ModuleNotFoundError: No module named"),
        ("glsim.stages", {"axe": "lab_extras.worst:WORST"}, ("stages", "axe"),
         "lab_extras.worst:WORST is not a function decorated with @glsim.array_stage, or a"),
        ("glsim.sensors", {"kinect-v2": "lab_extras"}, ("sensors",), "glsim has one of this name"),
    ],
)  # fmt: skip
def test_a_broken_package_is_one_line_that_names_it(
    lab: Path, group: str, entry: dict[str, str], arguments: tuple[str, ...], message: str
) -> None:
    shutil.rmtree(next(lab.glob("*.dist-info")))
    distribution(lab, "bad-lab", {group: entry})
    done = glsim_in(lab, *arguments)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    (name,) = entry
    assert line.startswith(f"glsim: error: package bad-lab: entry point {group}: {name}: ")
    assert message in line


def test_two_packages_with_one_name(lab: Path) -> None:
    distribution(lab, "other-lab", {"glsim.sensors": {"lab-cam": "lab_extras"}})
    done = glsim_in(lab, "sensors")
    assert done.returncode == 2
    assert "brings one of this name too: uninstall one of the two packages" in done.stderr


@pytest.mark.long
def test_adding_a_file_to_a_folder_of_glsim_is_enough(tmp_path: Path) -> None:
    """In a copy of glsim: a source, a stage, a sensor, a filter, an export, a check."""
    lab = PACKAGE / "lab_extras"
    home = tmp_path / "glsim"
    shutil.copytree(ROOT / "glsim", home)
    for name in ("train", "eval", "shaders"):  # as installed
        shutil.copytree(ROOT / name, home / name)
    for name, folder in (
        ("clay.py", "faces/sources"),
        ("ripple.glsl", "shaders/noise"),
        ("counts.py", "data/export/formats"),
        ("flat.py", "bench/validate/checks"),
    ):
        shutil.copy(lab / name, home / folder)
    camera = (lab / "lab-cam.toml").read_text().replace('[[stage]]\nuse = "speckle"\n', "")
    (home / "sensors/lab-cam.toml").write_text(camera)
    text = (
        (lab / "nearest.py").read_text().replace("    add_mm: float = 0.0\n", "    add_mm = 0.0\n")
    )
    text += '\nFILTERS = {"nearest": Nearest}\n'
    (home / "denoise/filters/nearest.py").write_text(text)
    assert "the camera of another laboratory" in output_of(tmp_path, "sensors")
    output_of(tmp_path, *GENERATE)
    output_of(tmp_path, "export", "data", "-o", "out", "--to", "counts")
    output_of(tmp_path, "eval", "data", "-o", "scores", "-d", "nearest")
    done = glsim_in(tmp_path, "validate", "lab-cam", "--frames", "8")
    assert "lab-cam: 1 checks: 1 pass" in done.stderr, done.stderr


FAILING = "def fail(*_): raise SystemExit(0)\n"


@pytest.mark.parametrize(
    "code",
    [
        "import sys; sys.exit(0)", "raise BaseException('no')", "1 / 0",
        FAILING + "raise type('E', (Exception,), {'__str__': fail})",
        FAILING + "gone = type('O', (), {'__getattr__': fail, '__call__': fail})()",
    ],
)  # fmt: skip
@pytest.mark.long
def test_a_broken_plugin_is_left_out_of_lists_and_refused_by_name(lab: Path, code: str) -> None:
    for module in ("ripple_stage", "worst"):
        (lab / "lab_extras" / f"{module}.py").write_text(code)
    distribution(
        lab, "broken",
        {"glsim.stages": {"gone": "lab_extras.ripple_stage:gone"},
         "glsim.sensors": {"gone-cam": "lab_extras.ripple_stage:gone"},
         "glsim.denoisers": {"gone": "lab_extras.ripple_stage:gone"}},
    )  # fmt: skip
    for command, kept in (("stages", "tof_light"), ("sensors", "kinect-v2"), ("eval", "face")):
        done = glsim_in(lab, command, *(["--list"] if command == "eval" else []))
        assert done.returncode == 0, done.stderr
        assert kept in done.stdout
        lines = [line for line in done.stderr.splitlines() if "left out" in line]
        usable = command == "eval" and "__call__" in code
        assert len(lines) == len(done.stderr.splitlines()) == 1 - usable, done.stderr
    done = glsim_in(lab, "sensors", "gone-cam")
    assert done.returncode == 2
    assert "package broken: entry point glsim.sensors: gone-cam: " in done.stderr
    assert "Traceback" not in done.stderr
