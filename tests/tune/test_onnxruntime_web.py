"""``glsim fetch onnxruntime-web``: three files of a package, from a file or by npm, or nothing."""

from __future__ import annotations

import hashlib
import importlib.util
import io
import shutil
import tarfile
from pathlib import Path

import pytest

from glsim.cli import main
from glsim.tune import onnxruntime_web
from glsim.tune.onnxruntime_web import FILES, TARBALL_NAME, runtime_folder


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GLSIM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def tarball(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package of the same layout, whose sum is the expected one from now on."""
    path = tmp_path / TARBALL_NAME
    with tarfile.open(path, "w:gz") as archive:
        for name in (
            *(f"dist/{file}" for file in FILES),
            "dist/other.js",
            "package.json",
            "README.md",
        ):
            data = name.encode()
            member = tarfile.TarInfo(f"package/{name}")
            member.size = len(data)
            archive.addfile(member, io.BytesIO(data))
    digest = hashlib.sha512(path.read_bytes()).hexdigest()
    monkeypatch.setattr(onnxruntime_web, "TARBALL_SHA512", digest)
    return path


def test_a_file_needs_no_network(
    tarball: Path, cache: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(onnxruntime_web, "subprocess", None)  # npm is not asked
    words = ["fetch", "onnxruntime-web", "--tarball", str(tarball)]
    assert main(words) == 0
    assert "MIT" in capsys.readouterr().err
    kept = sorted(file.name for file in runtime_folder().iterdir())
    assert kept == sorted([*FILES, "README.md", "package.json"])
    assert main(words) == 0
    assert "is there already" in capsys.readouterr().err
    (runtime_folder() / FILES[0]).unlink()
    assert main(words) == 0
    assert (runtime_folder() / FILES[0]).read_text() == f"dist/{FILES[0]}"


def test_other_bytes_are_refused_and_leave_nothing(
    tarball: Path, cache: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tarball.write_bytes(tarball.read_bytes() + b"more")
    assert main(["fetch", "onnxruntime-web", "--tarball", str(tarball)]) == 2
    said = capsys.readouterr().err
    assert f"is not {TARBALL_NAME} of npm: its SHA-512 is" in said
    assert not [path for path in cache.iterdir() if path.is_dir()]


def test_without_npm_and_with_one_that_fails_the_message_says_how(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    failing = tmp_path / "npm"
    failing.write_text("#!/bin/sh\necho 'npm error network' >&2\nexit 1\n")
    failing.chmod(0o755)
    monkeypatch.setattr(shutil, "which", lambda name: str(failing))
    assert main(["fetch", "onnxruntime-web"]) == 1
    said = capsys.readouterr().err
    assert "npm cannot download onnxruntime-web (npm error network)" in said
    assert f"--tarball {TARBALL_NAME}" in said
    monkeypatch.setattr(shutil, "which", lambda name: None)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert main(["fetch", "onnxruntime-web"]) == 2
    assert "there is no npm" in capsys.readouterr().err


def test_options_of_the_other_kind_are_refused(
    tarball: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["fetch", "people", "--tarball", str(tarball)]) == 2
    assert "--tarball does not go with people, which has --wheel" in capsys.readouterr().err
    assert main(["tune", "--denoise"]) == 2
    assert "--denoise goes with --static DIR" in capsys.readouterr().err
