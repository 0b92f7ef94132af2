"""Open files that others made: regular files only, of bounded size, inside their folder.

Everything that goes wrong is an OSError whose ``strerror`` says why, so that each reader reports
it as it reports a missing file.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path
from typing import IO


def open_regular(path: Path, limit: int | None = None) -> IO[bytes]:
    """Open a file for reading. Raises OSError for a pipe, a device, a folder or a NUL in its name.

    limit: largest size, bytes; a larger file is an OSError. A pipe would wait for a writer for
    ever and a device has no end, so the kind is known before the file is opened.
    """
    try:
        _refuse_special(path.stat(), limit)
        # O_NONBLOCK: if the file became a pipe in between, opening it does not wait.
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except ValueError:
        raise OSError(errno.EINVAL, "its name holds a NUL byte") from None
    try:
        _refuse_special(os.fstat(descriptor), limit)
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_regular(path: Path, limit: int) -> bytes:
    """Read a whole file of at most ``limit`` bytes. Raises OSError as ``open_regular``."""
    with open_regular(path, limit) as file:
        data = file.read(limit + 1)
    if len(data) > limit:  # files of /proc have a size of 0, and a file may grow
        raise _too_large(len(data), limit)
    return data


def path_inside(root: Path, name: str) -> Path:
    """Return ``root / name``. Raises OSError if it leads out of ``root``, also through a link."""
    path = root / name
    try:
        real, base = os.path.realpath(path), os.path.realpath(root)
    except ValueError:
        raise OSError(errno.EINVAL, "its name holds a NUL byte") from None
    if not real.startswith(base.rstrip("/") + "/"):
        raise OSError(errno.EPERM, f"leads out of {root}")
    return path


def _refuse_special(status: os.stat_result, limit: int | None) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "is a pipe, a socket or a device, not a file")
    if limit is not None and status.st_size > limit:
        raise _too_large(status.st_size, limit)


def _too_large(size: int, limit: int) -> OSError:
    return OSError(errno.EFBIG, f"{size / 1e6:.0f} MB are more than the {limit / 1e6:.3g} allowed")
