"""The text of every error is one line of bounded length."""

import json
import pickle
from types import SimpleNamespace

import pytest

from glsim.core.errors import ConfigError, DatasetError, did_you_mean, pip_install


@pytest.mark.parametrize(
    ("message", "shown"),
    [
        ("plain é 頭 text", "plain é 頭 text"),
        ("two\nlines\r\n", r"two\nlines\r\n"),
        ("a\0b\x1b[2Jc\x9b", r"a\x00b\x1b[2Jc\x9b"),
    ],
)
def test_control_characters_are_escaped(message: str, shown: str) -> None:
    assert str(ConfigError(message)) == shown
    assert str(pickle.loads(pickle.dumps(ConfigError(message)))) == shown


def test_the_middle_of_a_long_message_is_left_out() -> None:
    text = str(DatasetError("start " + "x" * 100_000 + " end"))
    assert len(text) <= 2500
    assert text.startswith("start xx")
    assert text.endswith("xx end")
    assert str(DatasetError()) == ""


def test_a_name_within_a_longer_one_is_proposed() -> None:
    sensors = ["kinect-v2", "realsense-d415", "realsense-d435", "realsense-d435-vga"]
    text = did_you_mean("D435", sensors)
    assert text == "did you mean 'realsense-d435' or 'realsense-d435-vga'?"
    assert did_you_mean("kinekt-v2", sensors) == "did you mean 'kinect-v2'?"
    assert did_you_mean("v", sensors).startswith("known: ")


def test_an_extra_is_installed_from_where_glsim_came(monkeypatch: pytest.MonkeyPatch) -> None:
    record: dict[str, object] = {}
    found = SimpleNamespace(read_text=lambda name: json.dumps(record))
    monkeypatch.setattr("importlib.metadata.distribution", lambda name: found)
    assert pip_install("eval") == "pip install 'glsim[eval]'"
    record |= {"url": "file:///a%20b/glsim", "dir_info": {"editable": True}}
    assert pip_install("eval") == "pip install -e '/a b/glsim[eval]'"
    record["dir_info"] = {}
    assert pip_install("train").startswith("pip install '/a b/glsim[train]' (without a GPU first")
