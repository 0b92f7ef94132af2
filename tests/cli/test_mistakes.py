"""Mistakes of a newcomer, each tried: one line that says what is wrong, and no traceback."""

from __future__ import annotations

import importlib
import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from glsim.cli import app, main
from glsim.files.exr import encode_exr
from glsim.files.png import encode_png
from tests.support.dataset_fakes import make, make_settings, make_tasks
from tests.support.user_rights import ordinary_user

#: What lies in the folder: data (a data set), damaged (a data set with half a header), maps (four
#: maps), mixed (maps of two sizes), map.png, small.npy (floats), file.* (words in place of what
#: the suffix says), cut.* (the first half of such a file), colour.png, latin.toml (not UTF-8),
#: blank.toml, broken.toml, *.obj (no meshes), loop (a link to itself), gone.png (a link to
#: nothing), empty/.
MISTAKES = """
generate
generate -o data --subjects 0
generate -o data --subjects -3
generate -o data --subjects many
generate -o data
generate -o map.png --subjects 1
generate -o new --source peple
generate -o new --source folder
generate -o new --source folder --root empty
generate -o new --source folder --root nothing
generate -o new --source ict-facekit --root empty
generate -o new --sensor kinect-v3
generate -o new --sensor nothing.toml
generate -o new --sensor broken.toml
generate -o new --preset offce
generate -o new --config broken.toml
generate -o new --config nothing.toml
generate -o new --set pose.yaw_dg=3
generate -o new --set pose.yaw_deg
generate -o new --set 'pose.yaw_deg={ unifrm = [1, 2] }'
generate -o new --set 'pose.yaw_deg={ uniform = [30, -30] }'
generate -o new --set pose.distance_mm=0
generate -o new --set tof_light.gain=nan
generate -o new --set output.crop=100000
generate -o new --crop 0
generate -o new --split 0.5,0.6,0.2
generate -o new --split a,b,c
generate -o new --layers clean,nosy
generate -o new --depth-unit-mm 0
generate -o new --workers none
generate -o new --format tar
generate -o s3://
generate -o http://server/data --subjects 1
generate -o new --part 3/2
generate -o new --seed 1.5
render
render nothing.obj
render face.obj -o out
render map.png -o out
render face.obj --sensor ideal --set strict=yes
corrupt map.png
corrupt nothing.png -o out.png
corrupt file.png -o out.png
corrupt map.png -o map.png
corrupt map.png -o out.jpg
corrupt map.png -o out.png --backend vulkan
corrupt map.png -o out.png --focal-px -3
corrupt map.png -o out.png --centre-px 3
corrupt empty -o out
denoise map.png
denoise nothing.png -o out.png
denoise file.png -o out.png
denoise map.png -o map.png
denoise map.png -o out.png -d face.onx
denoise map.png -o out.png -d face:min_probability=2
denoise map.png -o out.png -d median:size=4
denoise map.png -o out.png -d file.onnx
denoise map.png -o out.png --composite hardest
denoise map.png -o out.png -d median --uncertainty s.png
denoise map.png -o out.png --device broken.toml
denoise map.png -o out.png --protocol papr
eval
eval nothing -d median
eval empty -d median
eval data -d medan
eval data --split tset -d median
eval data -d median --truth expcted
train
train fase --data data
train face
train face --data nothing
train face --data data --set optimiser.lr=high
train face --data data --steps 0
train face --data data --minutes -1
train face --data data --resume --from nothing.pt
export data -o out --to plyy
export nothing -o out
export map.png -o out
verify nothing
verify empty
preview nothing -o seen
preview data -o map.png/seen
preview data -o seen --split tset
inspect nothing
validate kinect-v3
validate broken.toml
sensors kinect-v3
sensors kinect-v2 -o data
sensors -o mine.toml
stages tof_ligt
stages broken.toml
compare nothing data
fit nothing -o mine.toml
fit empty -o mine.toml
import biwi nothing -o real
import kinekt2 empty -o real
fetch peple
tune kinect-v3
info --backend vulkan
genrate -o data
paper tables data --table 9
transfer --plan --study nothing.toml
generate -o new --subjects 1e9
generate -o new --subjects 99999999999999999999999
generate -o new --seed -1
generate -o new --seed 99999999999999999999
generate -o new --set pose.distance_mm=-900
generate -o new --set pose.distance_mm=inf
generate -o new --set pose.distance_mm=1e12
generate -o new --config latin.toml
generate -o new --config empty
generate -o new --sensor blank.toml
generate -o new --depth-unit-mm nan
generate -o new --workers -2
generate -o new --merge
generate -o new --merge --part 1/2
generate -o new --part -1/2
generate -o new --slurm 0
generate -o new --slurm-set cpus_per_task=2
generate -o new --leave
generate -o new --json
generate -o new --price-per-core-hour 0.04
generate -o new --frames-per-second 0 --plan
generate -o new --framing face
generate -o new --source people --framing legs
generate -o new --unit furlong
generate -o new --source folder --root maps
generate -o new --source folder --root face.obj
generate -o new --source folder --root loop
generate -o new --source d3dfacs --root empty
generate -o new --source facewarehouse --root empty
generate -o new --source kinect2 --root empty
generate -o new --layers ''
generate -o new --split nan,0,1
generate -o new --protocol paper2
generate -o new --backend directx
generate -o map.png/new --subjects 1
generate -o maps --subjects 1
render nan.obj -o out
render huge.obj -o out
render index.obj -o out
render empty -o out
render loop -o out
render face.obj -o out --seed x
corrupt cut.png -o out.png
corrupt colour.png -o out.png
corrupt cut.npy -o out.npy
corrupt three.npy -o out.npy
corrupt words.npy -o out.npy
corrupt file.tiff -o out.tiff
corrupt gone.png -o out.png
corrupt loop -o out.png
corrupt maps -o maps
corrupt maps -o map.png
corrupt map.png -o out.png --depth-unit-mm nan
corrupt map.png -o out.png --focal-px nan
corrupt map.png -o out.png --centre-px nan,3
corrupt map.png -o out.png --seed -5
corrupt map.png -o out.png --set tof_light.gain=abc
denoise cut.png -o out.png -d median
denoise colour.png -o out.png -d median
denoise three.npy -o out.npy -d median
denoise maps -o maps -d median
denoise maps -o out.png -d median
denoise map.png small.npy -o out.png -d median
denoise map.png -o out.png -d median --out-unit-mm nan
denoise map.png -o out.png -d median --format bmp
denoise map.png -o out.png -d file.pt
denoise map.png -o out.png -d os:system
denoise map.png -o out.png -d nomodule:f
denoise map.png -o out.png -d median:size=nan
denoise map.png -o out.png --around hand
denoise map.png -o out.png --infrared file.png -d median
denoise 'nothing*.png' -o out
live
live nothing
live empty
live cut.png
live map.png --port 99999
live --camera webcam
live maps --camera realsense
live maps -d medan --no-browser
live maps -d median --host no.host.at.all. --no-browser
live maps --around hand --no-browser
live maps -d median --depth-unit-mm 0
eval damaged -d median -o scores
eval maps -d median -o scores
eval data -d median -o map.png
eval data -d median --workers 0 -o scores
eval data -d median --focal-px nan -o scores
eval-real
eval-real empty
eval-real mixed -o scores
eval-real maps -d medan -o scores
eval-real maps --board 5xa -o scores
eval-real maps --focal-px -3 -o scores
eval-real maps --markdown empty -o scores
eval-real maps -o map.png
train file.toml --data data
train latin.toml --data data
train face --data damaged -o run
train face --data data --simulate -o run
train face --data data -o run --steps nan
train face --data data -o run --minutes inf
train face --data data -o run --set nothing.at_all=3
train face --data data -o run --protocol papr
export damaged -o out --to ply
export data -o data --to ply
export data -o map.png --to ply
export data -o out --to ply --split tset
export file.pt -o out.onnx
export file.pt -o out.txt
export data -o out --to ply --hf a/b
verify damaged
preview maps -o seen
preview data -o seen --frames 0
inspect cut.png
inspect file.bag
inspect nan.obj
inspect loop
validate ideal --seed -1
validate ideal --figure out.txt
validate ideal --json map.png/x.json
validate ideal --markdown empty
sensors empty
sensors ideal -o map.png/mine.toml
stages nothing.glsl
compare data
compare data data --frames 0
compare data data --focal-px nan
compare data data --set a.b=3
compare data --replay kinect-v3
compare data data --figure x.txt
compare data data -o empty
compare mixed mixed
compare damaged data
fit map.png -o mine.toml
fit mixed -o mine.toml
fit maps -o mine.txt
fit maps -o map.png/mine.toml
fit maps -o mine.toml --albedo nan
fit maps -o mine.toml --base ideal
fit maps -o mine.toml --infrared empty
fit cut.png -o mine.toml
import nothing
import biwi map.png -o real
import kinect2 maps -o maps
import kinect2 cut.png -o real
fetch
fetch people --wheel file.whl
fetch people --wheel nothing.whl
tune file.toml
tune ideal --port -1
tune ideal --host no.host.at.all. --no-browser
tune ideal --set pose.yaw_deg=nan --no-browser
transfer
transfer -o new --leave sensor:zzz --plan
transfer -o new --steps 0 --plan
transfer -o new --sensor file.toml --plan
transfer -o new --network file.onnx --small
transfer -o new --ict-root nothing --plan
transfer -o new --ict-root . --plan
paper nothing
paper tables empty
paper page nothing
paper figures nothing
paper ssim nothing
paper reproduce --plan --size huge -o new
--nothing
''
""".strip().splitlines()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("newcomer")
    fill(place)
    return place


def fill(place: Path) -> None:
    """Put the good and the bad files of MISTAKES into a folder."""
    make(place / "data", make_settings(), make_tasks(4, 3))
    image = encode_png(np.full((32, 40), 900, np.uint16))
    (place / "map.png").write_bytes(image)
    (place / "cut.png").write_bytes(image[: len(image) // 2])
    for name in ("maps/a", "maps/b", "maps/c", "maps/d", "mixed/a"):
        (place / name).parent.mkdir(exist_ok=True)
        (place / f"{name}.png").write_bytes(image)
    (place / "mixed" / "b.png").write_bytes(encode_png(np.full((20, 30), 900, np.uint16)))
    Image.new("RGB", (40, 32)).save(place / "colour.png")
    np.save(place / "small.npy", np.full((8, 8), 0.9, np.float32))
    np.save(place / "three.npy", np.full((8, 8, 3), 0.9, np.float32))
    np.save(place / "words.npy", np.array([["a", "b"]]))
    (place / "cut.npy").write_bytes((place / "small.npy").read_bytes()[:150])
    for suffix in ("png", "tiff", "exr", "pt", "onnx", "whl", "toml", "bag"):
        (place / f"file.{suffix}").write_text("just words")
    (place / "broken.toml").write_text("[rig\n")
    (place / "blank.toml").write_text("")
    (place / "latin.toml").write_bytes(b'title = "caf\xe9"\n')
    (place / "face.obj").write_text("no mesh")
    for name, point in (("nan", "nan 0 0"), ("huge", "1e308 0 0"), ("index", "1 0 0\nf 1 2 9")):
        (place / f"{name}.obj").write_text(f"v 0 1 0\nv 0 0 1\nv {point}\nf 1 2 3\n")
    (place / "damaged").mkdir()
    (place / "damaged" / "dataset.json").write_text('{"format')
    (place / "loop").symlink_to("loop")
    (place / "gone.png").symlink_to("nothing.png")
    (place / "empty").mkdir()


def listing(folder: Path) -> set[str]:
    return {str(Path(at, name)) for at, _, names in os.walk(folder) for name in names}


def said_by(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Run a wrong command line; returns its only error, the last line of stderr."""
    status = main(arguments)
    said = capsys.readouterr().err
    assert status in (1, 2), said
    assert "Traceback" not in said
    assert "(a bug" not in said
    errors = [text for text in said.splitlines() if text.startswith("glsim: error: ")]
    if arguments[:1] == ["verify"]:  # its problems are its output
        assert not errors
        return ""
    assert len(errors) == 1, said
    assert said.splitlines()[-1] == errors[0]
    assert len(errors[0]) > len("glsim: error: ") + 10
    return errors[0]


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_one_line(
    folder: Path, line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("GLSIM_CACHE", str(folder / "cache"))
    monkeypatch.delenv("HF_TOKEN", raising=False)
    before = listing(folder)
    said_by(shlex.split(line), capsys)
    left = {name for name in listing(folder) - before if "cache" not in name}
    # An evaluation of which all frames are bad, and the lock of a data set, say nothing false.
    assert not {name for name in left if Path(name).name != "lock"}, left


def test_every_command_has_mistakes() -> None:
    tried = {line.split()[0] for line in MISTAKES}
    assert {info.name for info in app.registered_commands} <= tried
    assert {info.name for info in app.registered_groups} <= tried


def test_a_file_that_is_cut_short_is_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("OpenEXR")
    monkeypatch.chdir(folder)
    whole = encode_exr(np.full((64, 64), 0.9, np.float32))
    Path("cut.exr").write_bytes(whole[: len(whole) // 2])
    for name in ("cut.exr", "file.exr"):
        for command in (["corrupt"], ["denoise", "-d", "median"]):
            said = said_by([*command, name, "-o", "out.exr"], capsys)
            assert said == f"glsim: error: {name}: is cut short, or no OpenEXR file"
    assert not Path("out.exr").exists()


def test_code_of_ones_own_that_fails_is_named(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    spec = "mine@os:system"
    said = said_by(["denoise", "map.png", "-o", "out.png", "-d", spec], capsys)
    assert said.startswith("glsim: error: mine: TypeError: system() takes")


@pytest.mark.parametrize(
    "line",
    [
        "corrupt map.png -o READ/out.png --sensor ideal --backend numpy",
        "denoise map.png -o READ/out.png -d median",
        "sensors ideal -o READ/mine.toml",
        "validate ideal --json READ/checks.json",
        "compare data data -o READ/table.md",
        "fit maps -o READ/mine.toml",
        "export data -o READ/out --to ply",
        "eval data -d median -o READ/scores",
        "eval-real maps -d median -o READ/scores",
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
        said = said_by(shlex.split(line), capsys)
        monkeypatch.undo()
        assert "READ" in said
        assert "Permission denied: check the permissions" in said
        assert not listing(place / "READ")


def test_names_that_are_no_utf8_fail_in_one_line(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    name = os.fsdecode(b"caf\xe9.png")
    for command in ("corrupt", "denoise", "inspect", "render"):
        assert "caf" in said_by([command, name, "-o", "out.png"], capsys)
    Path(name).write_bytes(b"half a map")
    try:
        for command in ("corrupt", "denoise"):
            assert "caf" in said_by([command, name, "-o", "out.png"], capsys)
    finally:
        Path(name).unlink()


def test_mistakes_are_single_lines_in_a_narrow_ascii_terminal(folder: Path) -> None:
    """Everything in one process: starting one takes longer than the mistakes."""
    name = "caf\\udce9 \\u3042.png"
    program = f"""
from glsim.cli import main
for line in {MISTAKES[::9]!r}:
    import shlex
    assert main(shlex.split(line)) in (1, 2), line
for command in ("corrupt", "denoise", "inspect"):
    assert main([command, "{name}", "-o", "out.png"]) == 2
assert main(["generate", "-o", "new", "--sensor", "kin\\u00e9ct-v2"]) == 2
"""
    environment = {**os.environ, "LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    environment |= {"COLUMNS": "40", "GLSIM_CACHE": str(folder / "cache")}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env=environment, capture_output=True
    )
    said = done.stderr.decode("ascii")
    assert done.returncode == 0, said
    assert "Traceback" not in said
    assert "(a bug" not in said
    errors = [line for line in said.splitlines() if line.startswith("glsim: error: ")]
    verified = sum(line.startswith("verify ") for line in MISTAKES[::9])
    assert len(errors) == len(MISTAKES[::9]) - verified + 4
