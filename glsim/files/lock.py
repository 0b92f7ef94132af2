"""Lock a folder, so that two runs do not write it at the same time."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from glsim.errors import GlsimError
from glsim.files.atomic import cannot_write


@contextmanager
def locked(file: Path, busy: GlsimError) -> Iterator[None]:
    """Hold the lock ``file``; the kernel frees it when the process dies.

    Raises ``busy`` if another process holds it, DatasetError if it cannot be made.
    """
    lock = FileLock(file, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        raise busy from None
    except OSError as error:
        raise cannot_write(file, error) from error
    try:
        yield
    finally:
        lock.release()
