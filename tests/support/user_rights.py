"""Run a part of a test as an ordinary user, also in a container of root."""

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_NOBODY = 65534  # the user without rights, on all Linux systems


@contextmanager
def ordinary_user() -> Iterator[Path]:
    """Yield a new folder of an ordinary user (not root), who runs the block."""
    folder = Path(tempfile.mkdtemp(prefix="glsim-test-"))
    root = os.geteuid() == 0
    try:
        if root:
            os.chown(folder, _NOBODY, _NOBODY)
            os.seteuid(_NOBODY)
        yield folder
    finally:
        if root:
            os.seteuid(0)
        for path in [folder, *folder.rglob("*")]:
            if not path.is_symlink():
                path.chmod(0o700)
        shutil.rmtree(folder)
