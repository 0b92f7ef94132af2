"""Lock a folder, so that two runs do not write it at the same time."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from glsim.errors import GlsimError
from glsim.files.atomic import cannot_write


@contextmanager
def locked(file: Path, busy: GlsimError, *, wait: bool = False) -> Iterator[None]:
    """Hold an exclusive lock; the kernel frees it when the process dies.

    Raises ``busy`` if another process holds it, DatasetError if it cannot be made.

    Args:
        wait: wait until others free it, instead of raising ``busy``.
    """
    lock = FileLock(file, timeout=-1 if wait else 0)
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


@contextmanager
def locked_together(file: Path, busy: GlsimError) -> Iterator[None]:
    """Hold a shared lock, which excludes processes that hold it alone.

    Raises as ``locked``.
    """
    try:
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        raise cannot_write(file, error) from error
    try:
        try:
            # The same kind of lock as FileLock's, which is exclusive.
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            raise busy from None
        except OSError as error:
            raise cannot_write(file, error) from error
        yield
    finally:
        os.close(descriptor)
