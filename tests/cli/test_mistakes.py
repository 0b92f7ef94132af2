"""Mistakes of a newcomer: one line that says what is wrong, its exit status, and no traceback."""

import importlib
import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from glsim.cli import main
from glsim.core.files.png import encode_png
from tests.support.dataset_fakes import make, make_settings, make_tasks
from tests.support.user_rights import ordinary_user

#: Wrong usage or settings: exit status 2.
USAGE = """
''
--nothing
genrate -o data
generate
generate -o data --subjects 0
generate -o new --subjects 99999999999999999999999
generate -o new --source folder
generate -o new --root maps
generate -o new --sensor own.toml # none.glsl: no such file in
generate -o new --preset offce
generate -o http://server/data --subjects 1
generate -o new --part 3/2
generate -o new --part 1/2 --ray auto
render
corrupt nothing.png -o out.png
corrupt map.png -o map.png
corrupt map.png -o out.png --centre-px 3
corrupt map.png -o out.png --set pose.yaw_deg=3
denoise maps -o maps/out -d median
eval data -d median -o data
denoise map.png -o map.png
preview results
inspect results
denoise map.png -o out.png -d medan
eval data -d median -o scored
train fase --data data
train face --data data --steps 0
export data -o out --to plyy
export results/figures -o out # folder of a run: give results/figures/best.pt
export data/dataset.json -o out # data set: data
render data # is a data set, not a mesh
generate -o new --config data/dataset.json # is JSON
generate -o new --config own.toml # as --sensor
generate -o new --sensor seed.toml # as --config
import biwi nothing -o new # the biwi set
inspect nothing
inspect empty # and is no recording
inspect maps -o look.png # glsim preview maps -o
fit maps -o broken.toml # is there already
sensors kinect-v2 -o data
stages tof_ligt
compare data
fit nothing -o mine.toml
import nothing
fetch peple
tune kinect-v3
paper nothing
""".strip().splitlines()
#: Files that cannot be read or written: exit status 1.
FILES = """
generate -o map.png --subjects 1
generate -o maps --subjects 1
render nothing.obj
render nan.obj -o out
corrupt cut.png -o out.png
corrupt map.png -o out.png --backend numpy -s kinect-v2-fast --set range_gate.near_mm=4000
corrupt colour.png -o out.png
denoise cut.png -o out.png -d median
eval empty -d median
eval maps -d median
eval data -d median -o map.png
train face --data nothing
train face --data maps # glsim adapt maps
export damaged -o out --to ply
verify damaged
preview data -o map.png/seen
compare damaged data
validate ideal --json map.png/x.json
sensors ideal -o map.png/mine.toml
""".strip().splitlines()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("newcomer")
    fill(place)
    return place


def fill(place: Path) -> None:
    """Put good and bad files into a folder."""
    make(place / "data", make_settings(), make_tasks(4, 3))
    image = encode_png(np.full((32, 40), 900, np.uint16))
    (place / "map.png").write_bytes(image)
    (place / "cut.png").write_bytes(image[: len(image) // 2])
    for name in ("maps/a", "maps/b"):
        (place / name).parent.mkdir(exist_ok=True)
        (place / f"{name}.png").write_bytes(image)
    Image.new("RGB", (40, 32)).save(place / "colour.png")
    (place / "broken.toml").write_text("[rig\n")
    (place / "seed.toml").write_text("seed = 3\n")
    (place / "own.toml").write_text('extends = "ideal"\n[[stage]]\nuse = "none.glsl"\n')
    (place / "face.obj").write_text("no mesh")
    (place / "nan.obj").write_text("v 0 1 0\nv 0 0 1\nv nan 0 0\nf 1 2 3\n")
    (place / "damaged").mkdir()
    (place / "damaged" / "dataset.json").write_text('{"format')
    (place / "empty").mkdir()
    (place / "results/figures").mkdir(parents=True)
    for name in ("table.md", "rows.csv", "figures/bias.png", "figures/best.pt"):
        (place / "results" / name).write_text("scores")
    (place / "scored/.blocks").mkdir(parents=True)
    (place / "scored/.blocks/scored").write_text("test of another data set")


def listing(folder: Path) -> set[str]:
    return {str(Path(at, name)) for at, _, names in os.walk(folder) for name in names}


def one_line(said: str, words: list[str]) -> str:
    """Return the only error, the last line of stderr."""
    assert "Traceback" not in said
    assert "(a bug" not in said
    errors = [text for text in said.splitlines() if text.startswith("glsim: error: ")]
    if words[:1] in (["verify"], []):  # its problems are its output; no arguments: the help
        return ""
    assert len(errors) == 1, said
    assert said.splitlines()[-1] == errors[0]
    return errors[0]


@pytest.mark.parametrize(
    ("line", "status"), [*((line, 2) for line in USAGE), *((line, 1) for line in FILES)]
)
def test_a_mistake_is_one_line_and_writes_nothing(
    folder: Path, line: str, status: int, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(folder)
    monkeypatch.setenv("GLSIM_CACHE", str(folder / "cache"))
    before = listing(folder)
    words = shlex.split(line, comments=True)
    assert main(words) == status
    assert line.partition("# ")[2] in one_line(capsys.readouterr().err, words)
    left = {name for name in listing(folder) - before if "cache" not in name}
    assert not {name for name in left if Path(name).name != "lock"}, left


@pytest.mark.parametrize(
    "line",
    [
        "corrupt map.png -o READ/out.png --sensor ideal --backend numpy",
        "denoise map.png -o READ/out.png -d median",
        "export data -o READ/out --to ply",
        "eval data -d median -o READ/scores",
        "preview data -o READ/seen",
    ],
)
def test_an_output_that_must_not_be_written(
    line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for module in ("mmap", "statistics"):  # which that user could not import from a home of root's
        importlib.import_module(module)
    with ordinary_user() as place:
        fill(place)
        (place / "READ").mkdir(mode=0o500)
        monkeypatch.chdir(place)
        assert main(shlex.split(line)) == 1
        monkeypatch.undo()
        said = one_line(capsys.readouterr().err, [line])
        assert "READ" in said
        assert "Permission denied: check the permissions" in said
        assert not listing(place / "READ")


@pytest.mark.parametrize(
    ("line", "advice"),
    [
        ("generate --crop 128 -o new", "is a setting: --set output.crop=128"),
        ("generate -o new --depth-unit-mm=.1", "is a setting: --set output.depth_unit_mm=.1"),
        ("generate -o new --yaw-deg", "is a setting: --set pose.yaw_deg=VALUE"),
        ("render face.obj --format webdataset", "is a setting: --set output.format=webdataset"),
        (
            "generate --set pose.yaw_deg={ uniform=[1,2]}",
            "splits this value: quote all of it, '...'",
        ),
        ("inspect faces --rotation-deg 10 -o new", "--rotation-deg: give 3 numbers, X Y Z"),
    ],
)
def test_options_that_are_settings_or_broken_say_what_to_write(
    line: str, advice: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(shlex.split(line)) == 2
    assert f"{advice} (see --help)" in capsys.readouterr().err


def test_mistakes_are_single_lines_in_an_ascii_terminal(folder: Path) -> None:
    """Everything in one process: starting one takes longer than the mistakes."""
    lines = [line for line in USAGE[::7] if line != "''"]
    program = f"""
import shlex
from glsim.cli import main
for line in {lines!r}:
    assert main(shlex.split(line)) == 2, line
assert main(["corrupt", "caf\\udce9 \\u3042.png", "-o", "out.png"]) == 2
"""
    environment = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env=environment, capture_output=True
    )
    said = done.stderr.decode("ascii")
    assert done.returncode == 0, said
    errors = [line for line in said.splitlines() if line.startswith("glsim: error: ")]
    assert len(errors) == len(lines) + 1
