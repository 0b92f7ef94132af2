"""Open untrusted files: only regular files, of bounded size, inside their folder.

Every failure is an OSError whose ``strerror`` gives the reason, as for a missing file.
"""

from __future__ import annotations

import csv
import errno
import mmap
import os
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

from glsim.core.errors import DatasetError

#: Largest text, header or unpacked part that a reader holds, bytes. Recorders of bags make parts of
#: 1 to 4 MB; MakeHuman's weights, the largest known JSON, have 2 MB. The value was chosen.
MOST_HELD = 1 << 26
#: Largest image file, bytes a pixel (a renderer's 60 channels of 32 bits), and besides. Chosen.
_PIXEL_BYTES, _OTHER_BYTES = 256, 1 << 23


def open_regular(path: Path, limit: int | None = None, *, inside: Path | None = None) -> IO[bytes]:
    """Open a file for reading. Raises OSError for a pipe, a device, a folder or a NUL in its name.

    OSError is also raised for more than ``limit`` bytes, and for links out of the folder
    ``inside``. The kind is checked before opening: a pipe would wait for ever.
    """
    _check(path, limit, inside)
    return path.open("rb")


class BoundedFile:
    """A file for a library, which may read ``left`` bytes; ValueError with ``problem`` for more."""

    def __init__(self, file: Any, left: int, problem: str) -> None:
        self._file, self.left, self._problem = file, left, problem
        self.seek, self.tell, self.close = file.seek, file.tell, file.close

    def read(self, size: int = -1) -> bytes:
        """Read up to ``size`` bytes; none once the problem was raised."""
        if self.left < 0:
            return b""
        data: bytes = self._file.read(min(size, self.left + 1))
        self.left -= len(data)
        if self.left < 0:
            raise ValueError(self._problem)
        return data

    def __enter__(self) -> BoundedFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def read_regular(path: Path, limit: int, *, inside: Path | None = None) -> bytes:
    """Read a whole file of at most ``limit`` bytes. Raises OSError as ``open_regular``."""
    size = _check(path, limit, inside) or limit  # files of /proc have size 0
    with path.open("rb") as file:
        data = file.read(size + 1)
    if len(data) > size:
        raise OSError(errno.EFBIG, f"its bytes are more than the {size} that it says")
    return data


def read_data(path: Path, limit: int, *, inside: Path | None = None) -> bytes:
    """Read a whole file of a recording as ``read_regular`` does. Raises DatasetError."""
    try:
        return read_regular(path, limit, inside=inside)
    except OSError as error:
        raise DatasetError(f"{path}: {error.strerror or error}") from None


def read_pixels(
    path: Path, pixels: Callable[[mmap.mmap], int], *, inside: Path | None = None
) -> bytes:
    """Read an image file; ``pixels`` finds their number in the header, before the rest is read.

    Raises DatasetError, also for far more bytes than the pixels take.
    """
    count = 0
    with suppress(OSError), open_regular(path, inside=inside) as file:
        if os.fstat(file.fileno()).st_size:
            with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                count = pixels(content)
    return read_data(path, _OTHER_BYTES + _PIXEL_BYTES * count, inside=inside)


def read_csv(path: Path) -> list[dict[str, str]]:
    """Read the rows of a CSV but no comments (#). Raises OSError or UnicodeDecodeError."""
    lines = path.read_text(encoding="utf-8-sig").splitlines()
    return list(csv.DictReader(line for line in lines if not line.lstrip().startswith("#")))


def _check(path: Path, limit: int | None, inside: Path | None) -> int:
    """Return the size of a file, bytes. Raises the errors of ``open_regular``."""
    try:
        if inside is not None and not path.resolve().is_relative_to(inside.resolve()):
            raise OSError(errno.EPERM, f"leads out of {inside}")
        status = path.stat()
    except ValueError:
        raise OSError(errno.EINVAL, "its name holds a NUL byte") from None
    if stat.S_ISDIR(status.st_mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "is a pipe, a socket or a device, not a file")
    size = status.st_size
    if limit is not None and size > limit:
        reason = f"{size / 1e6:.0f} MB are more than the {limit / 1e6:.4g} allowed"
        raise OSError(errno.EFBIG, reason)
    return size
