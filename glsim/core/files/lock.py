"""Lock a file, so that two runs never write one folder at the same time."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from glsim.core.errors import GlsimError
from glsim.core.files.atomic import cannot_write

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]


@contextmanager
def locked(
    file: Path, busy: GlsimError, *, wait: bool = False, shared: bool = False
) -> Iterator[None]:
    """Hold a file lock during a block, or raise ``busy``; the kernel frees it if the process dies.

    Args:
        file: the lock file; it is created if it is missing (DatasetError if that fails), and stays.
        shared: several processes may hold the lock together, if all of them ask for a shared one;
            not on Windows, where one process holds it.
    """
    if fcntl is None:
        with _locked_by_filelock(file, busy, wait):
            yield
        return
    kind = (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB)
    try:
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
    except OSError as error:
        raise cannot_write(file, error) from error
    try:
        try:
            fcntl.flock(descriptor, kind)
        except BlockingIOError:
            raise busy from None
        except OSError as error:
            raise cannot_write(file, error) from error
        yield
    finally:
        os.close(descriptor)


@contextmanager
def _locked_by_filelock(file: Path, busy: GlsimError, wait: bool) -> Iterator[None]:
    from filelock import FileLock, Timeout

    lock = FileLock(file)
    try:
        lock.acquire(timeout=-1 if wait else 0)
    except Timeout:
        raise busy from None
    except OSError as error:
        raise cannot_write(file, error) from error
    try:
        yield
    finally:
        lock.release()
