"""What outlives the command: the cookie's secret and the last tuning."""

from __future__ import annotations

import os
import time
from pathlib import Path

import pytest

from glsim.tune.kept import KeptTuning, cookie_secret
from glsim.tune.state import Tuning

START = Tuning("kinect-v1")


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("GLSIM_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    return tmp_path / "cache" / "tune"


def test_the_secret_is_private_and_stays_for_30_days(cache: Path) -> None:
    first = cookie_secret()
    assert cookie_secret() == first
    file = cache / "secret"
    assert file.stat().st_mode & 0o777 == 0o600
    assert cache.stat().st_mode & 0o777 == 0o700
    old = time.time() - 31 * 86_400
    os.utime(file, (old, old))
    second = cookie_secret()
    assert second != first
    assert len(second) == len(first) == 32


def test_a_secret_that_others_can_read_or_that_is_damaged_is_replaced(cache: Path) -> None:
    first = cookie_secret()
    (cache / "secret").chmod(0o644)
    second = cookie_secret()
    assert second != first
    (cache / "secret").write_text("short")
    assert len(cookie_secret()) == 32


def test_without_a_cache_folder_it_still_works(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("GLSIM_CACHE", str(tmp_path / "file"))
    assert len(cookie_secret()) == 32
    KeptTuning(START, "render").save(START)
    assert KeptTuning(START, "render").load() is None


def test_the_last_tuning_is_that_of_the_same_start_and_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = KeptTuning(START, "render a.obj")
    assert kept.load() is None
    changed = START.with_value("axial.angle_mm", 2)
    kept.save(changed)
    assert kept.load() == changed
    assert KeptTuning(START, "render b.obj").load() is None
    assert KeptTuning(Tuning("ideal"), "render a.obj").load() is None
    (tmp_path / "other").mkdir()
    monkeypatch.chdir(tmp_path / "other")
    assert KeptTuning(START, "render a.obj").load() is None


def test_a_damaged_tuning_is_none(cache: Path) -> None:
    kept = KeptTuning(START, "")
    kept.save(START)
    (file,) = cache.glob("*.link")
    file.write_bytes(b"\xff\xfe")
    assert kept.load() is None
