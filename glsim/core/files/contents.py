"""Hash the contents of files, to notice a changed input."""

from __future__ import annotations

import hashlib
import stat
from functools import lru_cache
from pathlib import Path

#: Largest hashed file, bytes; larger files are compared by their size. No mesh or stage is as large
#: (``glsim.faces.meshes.obj.MAX_BYTES``), and hashing would take seconds.
_MAX_BYTES = 1_000_000_000
_BLOCK_BYTES = 1 << 20


def content_hash(path: Path) -> str:
    """Compute a hash of a file's bytes; for an unreadable file, return the reason as a text."""
    # A process reads a file again only if its size, time or inode has changed.
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            return "no regular file"
        if status.st_size > _MAX_BYTES:
            return f"{status.st_size} bytes"
        return _hash(path, status.st_size, status.st_mtime_ns, status.st_ino, status.st_dev)
    except (OSError, ValueError) as error:
        return f"unreadable: {getattr(error, 'strerror', None) or error}"


def text_hash(text: str) -> str:
    """Compute a hash of a text."""
    return hashlib.blake2b(text.encode("utf-8", "surrogateescape"), digest_size=16).hexdigest()


@lru_cache(maxsize=1 << 20)
def _hash(path: Path, *_: int) -> str:
    digest = hashlib.blake2b(digest_size=16)
    with path.open("rb") as file:
        while block := file.read(_BLOCK_BYTES):
            digest.update(block)
    return digest.hexdigest()
