"""Lock a file, so that two runs never write one folder at the same time."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from glsim.core.errors import GlsimError
from glsim.core.files.atomic import cannot_write


@contextmanager
def locked(
    file: Path, busy: GlsimError, *, wait: bool = False, shared: bool = False
) -> Iterator[None]:
    """Hold a file lock during a block; the kernel frees it if the process dies.

    Args:
        file: the lock file; it is created if it is missing (DatasetError if that fails), and stays.
        busy: the error if another process holds the lock.
        wait: wait until the lock is free, instead of raising ``busy``.
        shared: several processes may hold the lock together, if all of them ask for a shared one.
    """
    kind = (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | (0 if wait else fcntl.LOCK_NB)
    try:
        descriptor = os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW, 0o644)
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
