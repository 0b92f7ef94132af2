"""Folders of what registries hold: fetched once, whole or not at all, known by their checksum."""

from __future__ import annotations

import hashlib
import shutil
from collections.abc import Callable
from pathlib import Path

from glsim.errors import ConfigError, DatasetError
from glsim.files.atomic import temporary_folder, wrap_read_errors, wrap_write_errors
from glsim.files.lock import locked


def fetch_folder(
    target: Path,
    is_whole: Callable[[Path], bool],
    download: Callable[[Path], Path],
    unpack: Callable[[Path, Path], None],
    *,
    again: bool = False,
) -> bool:
    """Put a folder in its place, whole or not at all; one process of a machine does it.

    Args:
        target: the folder.
        is_whole: whether it is there already.
        download: puts an archive into a temporary folder, or takes one that is there; returns it.
        unpack: writes what is kept of the archive, its first argument, into a folder.
        again: replace a folder that is there.

    Returns:
        Whether it is new.

    Raises:
        DatasetError: the folder cannot be written.
    """
    with wrap_write_errors(target.parent):
        target.parent.mkdir(parents=True, exist_ok=True)
    busy = DatasetError(f"{target}: another process fetches it: wait until it ends")
    with locked(target.parent / f".{target.name}.lock", busy, wait=True):
        if is_whole(target) and not again:
            return False
        with temporary_folder(target.parent) as work:
            archive = download(work)
            with wrap_write_errors(target):
                unpack(archive, work / "data")
                if target.exists():
                    shutil.rmtree(target)  # damaged
                (work / "data").rename(target)
    return True


def check_digest(file: Path, algorithm: str, expected: str, release: str) -> None:
    """Raise ConfigError for a file of other bytes than those of a release.

    Args:
        file: a downloaded archive.
        algorithm: a name of ``hashlib``, as the registry states it.
        expected: hexadecimal digits.
        release: for the message, such as "NAME of PyPI".
    """
    with wrap_read_errors(file), file.open("rb") as opened:
        found = hashlib.file_digest(opened, algorithm).hexdigest()
    if found != expected:
        label = algorithm.upper().replace("SHA", "SHA-")
        raise ConfigError(f"{file}: is not {release}: its {label} is {found}, not {expected}")
