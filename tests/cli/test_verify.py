"""``glsim verify``: a list of problems, the exit status, and the command that repairs."""

import shlex
from pathlib import Path
from typing import Any

import pytest

from glsim.cli import main
from glsim.settings.schema import load_settings
from tests.support.dataset_fakes import make, make_settings, make_tasks

PNG = "train/s000/smile.1_00000_noisy.png"


@pytest.fixture
def tree(tmp_path: Path) -> Path:
    make(tmp_path / "data", make_settings(), make_tasks(4, 2))
    return tmp_path / "data"


def verify(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, list[str], str]:
    status = main(["verify", *map(str, arguments)])
    output = capsys.readouterr()
    return status, output.out.splitlines(), output.err


def test_a_sound_data_set(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    status, problems, message = verify(capsys, tree)
    assert (status, problems) == (0, [])
    assert message.endswith("sound: 8 frames (train 4, val 2, test 2); images were not read: "
                            "--deep does\n")  # fmt: skip
    status, _, message = verify(capsys, tree, "--deep")
    assert status == 0
    assert "every image was read" in message


def test_problems_are_listed_one_a_line(tree: Path, capsys: pytest.CaptureFixture[str]) -> None:
    data = bytearray((tree / PNG).read_bytes())
    data[-30] ^= 1
    (tree / PNG).write_bytes(data)
    (tree / (stray := "train/s000/stray[b].png")).touch()
    assert verify(capsys, tree)[1] == [f"{stray} is in no record: delete it, or move it out"]
    status, problems, said = verify(capsys, tree, "--deep")
    assert (status, "--repair prints the command" in said) == (1, True)
    assert problems[0].startswith(f"{PNG}: was changed after it was written")
    assert verify(capsys, tree.parent)[1] == [
        f"{tree.parent}: is no data set of glsim: it has no dataset.json; glsim generate -o NEW "
        "makes one"
    ]
    (folder,) = verify(capsys, tree / "train")[1]
    assert folder.endswith(f"it has no dataset.json, but {tree.absolute()} is one: give that")


@pytest.mark.parametrize(
    "tree",
    [
        {},
        {"sensor": "kinect-v1", "seed": 7, "source": {"kind": "procedural", "subjects": 2}},
        {
            "split": "paper",
            "pose": {"yaw_deg": {"uniform": [-30, 30]}, "distance_mm": 800},
            "stage": {"axial": {"base_sigma_mm": {"choice": [1, 2]}}},
            "rig": {"deliver": "raw"},
            "output": {"layers": ["clean", "noisy", "reason"], "format": "webdataset"},
            "source": [
                {"kind": "folder", "root": "my 'scans'\" é", "weight": 2},
                {"kind": "d3dfacs", "root": "d", "peak_only": True, "every": 5},
            ],
        },
    ],
)
def test_the_command_that_repairs_gives_the_same_settings(
    tmp_path: Path, tree: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    settings = load_settings(overrides=tree)
    out = tmp_path / "my data"
    make(out, settings, make_tasks(4, 1))
    for broken in ("", "dataset.json"):
        if broken:
            (out / broken).write_text("{")
        command = verify(capsys, out, "--repair")[1][-1]
        words = shlex.split(command)
        assert words[:4] == ["glsim", "generate", "-o", str(out)]
        assert set(words[4::2]) <= {"--set"}
        assert load_settings(None, words[5::2]) == settings
    (out / ".glsim" / "plan.json").unlink()
    assert verify(capsys, out, "--repair")[0] == 1


def test_the_command_that_repairs_an_import(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import tests.support.dataset_fakes as fakes

    monkeypatch.setattr(fakes, "SENSOR", {"name": "biwi", "stages": []})
    source = {"kind": "biwi", "root": "hpdb", "every": 10}
    settings = load_settings(overrides={"source": source, "split": "0,0,1"})
    make(tmp_path, settings, make_tasks(4, 1))
    command = verify(capsys, tmp_path, "--repair")[1][-1]
    assert command == f"glsim import biwi hpdb -o {tmp_path} --every 10 --split 0.0,0.0,1.0"
