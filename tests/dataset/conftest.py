"""What several tests of data sets compare with."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from glsim.files import atomic
from tests.support.dataset_fakes import FORMATS, SKIP, contents, make, make_settings


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, bytes]]:
    """Make the set that runs with faults must end with: format -> file -> bytes."""
    result = {}
    for format in FORMATS:
        out = tmp_path_factory.mktemp("undisturbed") / format
        make(out, make_settings(format=format), **SKIP)
        result[format] = contents(out)
    return result


@pytest.fixture
def read_only(monkeypatch: pytest.MonkeyPatch) -> Callable[[Path, int], None]:
    """Make a folder read-only, also for root: every way to change it fails with an error number."""

    def protect(folder: Path, number: int) -> None:
        def refuse(path: Any, *rest: Any) -> None:
            if Path(os.fsdecode(path)).is_relative_to(folder):
                raise OSError(number, os.strerror(number), str(path))

        def guarded(function: Any, writes: Callable[..., bool]) -> Any:
            def call(path: Any, *rest: Any, **options: Any) -> Any:
                if not isinstance(path, int) and writes(path, *rest):
                    refuse(path)
                return function(path, *rest, **options)

            return call

        def opens_to_write(path: Any, flags: int, *_: Any) -> bool:
            return bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))

        monkeypatch.setattr(os, "open", guarded(os.open, opens_to_write))
        monkeypatch.setattr(
            os, "mkdir", guarded(os.mkdir, lambda path, *_: not Path(path).exists())
        )
        for name in ("unlink", "rename", "replace", "rmdir"):
            monkeypatch.setattr(os, name, guarded(getattr(os, name), lambda *_: True))
        monkeypatch.setattr(atomic, "_create", guarded(atomic._create, lambda *_: True))

    return protect
