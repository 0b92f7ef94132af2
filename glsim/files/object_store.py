"""A folder in object storage as a store, see ``glsim.files.store``.

An object appears whole or not at all. A file is written on this machine's disk first, uploaded when
it is complete, and compared with what arrived.
"""

from __future__ import annotations

import logging
import secrets
import tempfile
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import IO, Any, TypeVar

from glsim.errors import DatasetError, GlsimError
from glsim.files.atomic import (
    AtomicFile,
    checksum,
    file_checksum,
    missing,
    temporary_folder,
    wrap_write_errors,
)
from glsim.files.cache_folder import cache_folder
from glsim.files.cloud import CONNECTIONS, CloudFolder
from glsim.files.contents import text_hash
from glsim.files.object_lock import object_lock

log = logging.getLogger(__name__)
_A = TypeVar("_A")
_B = TypeVar("_B")

#: Attempts to upload a file whose bytes do not arrive as they were sent.
_UPLOADS = 3
#: Largest object that ``put_first`` compares, bytes: far more than a plan has.
_MAX_FIRST_BYTES = 1 << 28


class ObjectStore(CloudFolder):
    """The store at a URL; its methods are those of ``Store``, with the requests of CloudFolder."""

    is_remote = True

    def __init__(self, url: str, temporary: Path | None = None) -> None:
        """Name the URL, and a folder of this machine for files that are being written."""
        super().__init__(url)
        self._temporary = temporary

    def __getstate__(self) -> dict[str, Any]:
        return {**super().__getstate__(), "_temporary": self._temporary}

    def open(self, name: str) -> IO[bytes]:
        """Open a temporary copy of an object."""
        size = self.size(name)
        if size is None:
            raise missing(self.where(name))
        file = tempfile.TemporaryFile()  # noqa: SIM115 (the caller closes it)
        for block in self.blocks(name, size):
            file.write(block)
        file.seek(0)
        return file

    def local(self, name: str, expected: dict[str, int] | None, key: str) -> Path:
        """Return a copy of an object in the cache of glsim."""
        file = cache_folder() / "cloud" / text_hash(f"{self.url} {key}") / name
        found = file_checksum(file)
        if found is not None and found == expected:
            return file
        size = self.size(name)
        if size is None:
            raise missing(self.where(name))
        if expected is not None and size != expected["size"]:
            raise DatasetError(
                f"{self.where(name)}: was changed after it was written ({size} bytes, "
                f"{expected['size']} recorded): run glsim generate again with the same settings "
                "to repair it"
            )
        log.info("%s: copying %.0f MB to %s", self.where(name), size / 1e6, file.parent)
        self.download(name, file)
        return file

    def map(self, function: Callable[[_A], _B], items: Iterable[_A]) -> Iterator[_B]:
        """Call a function for each item, in order, some items at the same time."""
        with ThreadPoolExecutor(CONNECTIONS) as pool:
            running: deque[Future[_B]] = deque()
            for item in items:
                running.append(pool.submit(function, item))
                if len(running) > CONNECTIONS:
                    yield running.popleft().result()
            while running:
                yield running.popleft().result()

    @contextmanager
    def writing(self, folder: str) -> Iterator[ObjectStore]:
        """Make a temporary folder of this machine, which ends with the block."""
        with temporary_folder() as temporary:
            yield ObjectStore(self.url, temporary)

    @contextmanager
    def create(self, name: str, *, sync: bool = True) -> Iterator[AtomicFile]:
        """Open a temporary file, and upload it when the block ends."""
        assert self._temporary is not None, "writes in the block of writing() only"
        local = self._temporary / f"{secrets.token_hex(8)}-{name.rpartition('/')[2]}"
        with AtomicFile(local, sync=False) as file:
            yield file
        for _ in range(_UPLOADS):
            self.upload(name, local)
            if self.checksum(name) == file.checksum:
                break
        else:
            raise DatasetError(f"{self.where(name)}: did not arrive as it was sent: run it again")
        with wrap_write_errors(local):
            local.unlink()

    def put(self, name: str, data: bytes, *, sync: bool = True) -> dict[str, int]:
        """Write a whole object."""
        self.write(name, data)
        return checksum(data)

    def put_first(self, name: str, data: bytes) -> bytes:
        """Write an object unless there is one; the store lets one process do so."""
        if self.write_new(name, data):
            return data
        return self.read(name, _MAX_FIRST_BYTES) or data

    def flush(self, names: Iterable[str]) -> None:
        """Do nothing: an object is stored when it appears."""

    def lock(
        self, name: str, busy: GlsimError, *, wait: bool = False, shared: bool = False
    ) -> AbstractContextManager[None]:
        """Hold an object as a lock."""
        return nullcontext() if shared else object_lock(self, name, busy, wait=wait)
