"""What outlives the command: the cookie's secret, and the last tuning of each start."""

from __future__ import annotations

import os
import secrets
import tempfile
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from glsim.errors import ConfigError
from glsim.files.cache_folder import cache_folder
from glsim.files.contents import text_hash
from glsim.files.regular import read_regular
from glsim.tune.state import Tuning, tuning_of_link

#: A browser's cookie is valid for this long, days; then a ticket is needed again.
_SECRET_DAYS = 30
_LARGEST = 1 << 17


def _folder() -> Path:
    folder = cache_folder() / "tune"
    folder.mkdir(parents=True, exist_ok=True)
    folder.chmod(0o700)
    return folder


def _write(path: Path, text: str) -> None:
    """Write a file that the user alone can read, and rename it into its place."""
    descriptor, name = tempfile.mkstemp(dir=path.parent)  # mode 0600
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(text)
    Path(name).replace(path)


def cookie_secret() -> str:
    """Return the value of the page's cookie; the same for 30 days, so that a bookmark works.

    A new one where the cache folder cannot be written.
    """
    new = secrets.token_urlsafe(24)
    try:
        path = _folder() / "secret"
        if path.exists() and time.time() - path.stat().st_mtime < _SECRET_DAYS * 86_400:
            kept = read_regular(path, _LARGEST).decode("ascii", "replace").strip()
            if len(kept) == len(new) and path.stat().st_mode & 0o077 == 0:
                return kept
        _write(path, new)
    except OSError:
        pass
    return new


@dataclass(frozen=True)
class KeptTuning:
    """The last tuning of a start of the command.

    Args:
        start: the tuning of the command's options.
        command: the words that name the faces.
    """

    start: Tuning
    command: str

    def _path(self) -> Path:
        words = "\n".join([str(Path.cwd()), self.command, self.start.link()])
        return _folder() / f"{text_hash(words)}.link"

    def save(self, tuning: Tuning) -> None:
        """Write the tuning; where the cache folder cannot be written, nothing is kept."""
        with suppress(OSError):
            _write(self._path(), tuning.link())

    def load(self) -> Tuning | None:
        """Return the tuning that was saved last; None without a readable one."""
        try:
            return tuning_of_link(read_regular(self._path(), _LARGEST).decode("ascii"))
        except (OSError, UnicodeDecodeError, ConfigError):
            return None
