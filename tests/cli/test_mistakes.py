"""Mistakes of a newcomer, each tried: one line that says what is wrong, and no traceback."""

from __future__ import annotations

import os
import shlex
from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.files.png import encode_png
from tests.support.dataset_fakes import make, make_settings, make_tasks

#: What lies in the folder: data (a data set), map.png, small.npy (floats), text.png (no picture),
#: face.obj (no mesh), broken.toml, empty/.
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
corrupt text.png -o out.png
corrupt map.png -o map.png
corrupt map.png -o out.jpg
corrupt map.png -o out.png --backend vulkan
corrupt map.png -o out.png --focal-px -3
corrupt map.png -o out.png --centre-px 3
corrupt empty -o out
denoise map.png
denoise nothing.png -o out.png
denoise text.png -o out.png
denoise map.png -o map.png
denoise map.png -o out.png -d face.onx
denoise map.png -o out.png -d face:min_probability=2
denoise map.png -o out.png -d median:size=4
denoise map.png -o out.png -d text.png.onnx
denoise map.png -o out.png --composite hardest
denoise map.png -o out.png -d median --uncertainty s.png
denoise map.png -o out.png --device broken.toml
denoise map.png -o out.png --protocol papr
denoise --watch nothing -o out
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
tune --static map.png/x
info --backend vulkan
genrate -o data
paper tables data --table 9
transfer --plan --study nothing.toml
""".strip().splitlines()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("newcomer")
    make(place / "data", make_settings(), make_tasks(4, 3))
    (place / "map.png").write_bytes(encode_png(np.full((32, 40), 900, np.uint16)))
    np.save(place / "small.npy", np.full((8, 8), 0.9, np.float32))
    (place / "text.png").write_text("no picture")
    (place / "text.png.onnx").write_text("no network")
    (place / "face.obj").write_text("no mesh")
    (place / "broken.toml").write_text("[rig\n")
    (place / "empty").mkdir()
    return place


def listing(folder: Path) -> set[str]:
    return {str(Path(at, name)) for at, _, names in os.walk(folder) for name in names}


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_one_line(
    folder: Path, line: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("GLSIM_CACHE", str(folder / "cache"))
    before = listing(folder)
    status = main(shlex.split(line))
    said = capsys.readouterr().err
    assert status in (1, 2), said
    assert "Traceback" not in said
    assert "(a bug" not in said
    errors = [text for text in said.splitlines() if text.startswith("glsim: error: ")]
    if line.startswith("verify "):  # its problems are its output
        assert not errors
    else:
        assert len(errors) == 1, said
        assert said.splitlines()[-1] == errors[0]
        assert len(errors[0]) > len("glsim: error: ") + 10
    left = {name for name in listing(folder) - before if "cache" not in name}
    assert not {name for name in left if Path(name).suffix in (".png", ".toml", ".jsonl")}, left
