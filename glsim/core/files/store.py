"""Store the files of a data set in a folder on disk; ``cloud`` stores them in a bucket."""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import IO, TypeVar

from glsim.core.errors import DatasetError, GlsimError
from glsim.core.files.atomic import AtomicFile, file_checksum, wrap_read_errors, wrap_write_errors
from glsim.core.files.flush import flush_all, flush_folder
from glsim.core.files.lock import locked
from glsim.core.files.regular import open_regular, read_regular

_A = TypeVar("_A")
_B = TypeVar("_B")
#: Largest file that ``put_first`` compares, bytes: a plan is far smaller.
MAX_FIRST_BYTES = 1 << 28


class Store:
    """A folder of files, each complete or absent; a store is cheap to send to other processes.

    The name of a file is its path in the folder, with slashes; neither ".." nor links may lead out
    of the folder. A method that fails raises DatasetError, which names the file. If ``is_remote``
    is true, each read takes a request over the network.
    """

    is_remote = False
    #: Name of a file -> the name that is read after it, if files are read in order.
    after: Mapping[str, str] = MappingProxyType({})

    def __init__(self, root: Path, temporary: Path | None = None) -> None:
        self.root, self._temporary = root, temporary
        self._made: set[Path] = set()

    def __str__(self) -> str:
        return str(self.root)

    def where(self, name: str) -> str:
        """Return the path or URL of a file, for messages."""
        return f"{self}/{name}"

    def names(self, folder: str) -> list[str]:
        """List the entries of a folder, sorted; [] if there is no such folder."""
        path = self.root / folder
        if not path.is_dir():
            if not folder and path.exists():
                raise DatasetError(f"{path}: is a file: choose a folder")
            return []
        if not path.resolve().is_relative_to(self.root.resolve()):
            raise DatasetError(f"{path}: leads out of {self.root}")
        with wrap_read_errors(path):
            return sorted(os.listdir(path))  # noqa: PTH208 (a million names)

    def size(self, name: str) -> int | None:
        """Return the size of a file, bytes; None if there is no such file."""
        try:
            with open_regular(self.root / name, inside=self.root) as file:
                return os.fstat(file.fileno()).st_size
        except FileNotFoundError:
            return None
        except OSError as error:
            raise DatasetError(f"{self.where(name)}: {error.strerror}") from None

    def checksum(self, name: str) -> dict[str, int] | None:
        """Return the size and CRC32 of a file; None if there is no such file."""
        return file_checksum(self.root / name)

    def read(self, name: str, limit: int) -> bytes | None:
        """Read a file of at most ``limit`` bytes; None if there is no such file."""
        with wrap_read_errors(self.root / name):
            try:
                return read_regular(self.root / name, limit, inside=self.root)
            except (FileNotFoundError, NotADirectoryError):
                return None

    def read_range(self, name: str, start: int, size: int) -> bytes:
        """Read ``size`` bytes of a file from byte ``start``, or fewer at its end."""
        with wrap_read_errors(self.root / name), self.open(name) as file:
            file.seek(start)
            return file.read(size)

    def open(self, name: str) -> IO[bytes]:
        """Open a file for reading; a remote file is first copied to a temporary file."""
        with wrap_read_errors(self.root / name):
            return open_regular(self.root / name, inside=self.root)

    def local(self, name: str, expected: dict[str, int] | None, key: str) -> Path:
        """Return a local file with the bytes of ``name``; a remote file is copied.

        An existing copy is used again if it has the ``expected`` size and CRC32. ``key`` names the
        version of the data set; the copies of a version share a folder.
        """
        return self.root / name

    def map(self, function: Callable[[_A], _B], items: Iterable[_A]) -> Iterator[_B]:
        """Call a function for each item, in order of the items; on remote stores in parallel."""
        return map(function, items)

    @contextmanager
    def writing(self, folder: str) -> Iterator[Store]:
        """Open the store for writing during a block; ``folder`` holds its temporary files."""
        temporary = self.root / folder
        with wrap_write_errors(temporary):
            shutil.rmtree(temporary, ignore_errors=True)
            temporary.mkdir(parents=True)
        try:
            yield Store(self.root, temporary)
        finally:
            shutil.rmtree(temporary, ignore_errors=True)

    def create(self, name: str, *, sync: bool = True) -> AbstractContextManager[AtomicFile]:
        """Open a new file for writing, which gets its name when the block ends without an error.

        An existing file is replaced. With ``sync`` it is flushed to the disk at once.
        """
        path = self.root / name
        if self._temporary is None:
            return AtomicFile(path, sync=sync)
        if path.parent not in self._made:
            with wrap_write_errors(path.parent):
                path.parent.mkdir(parents=True, exist_ok=True)
            self._made.add(path.parent)
        return AtomicFile(path, self._temporary / f"{secrets.token_hex(8)}-{path.name}", sync=sync)

    def put(self, name: str, data: bytes, *, sync: bool = True) -> dict[str, int]:
        """Write a file, with arguments as for ``create``; return its size and CRC32."""
        with self.create(name, sync=sync) as file:
            file.write(data)
        return file.checksum

    def put_first(self, name: str, data: bytes) -> bytes:
        """Write a file unless it exists; return the bytes of the file that then exists."""
        with locked(self.root / f"{name}.lock", DatasetError(), wait=True):
            found = self.read(name, MAX_FIRST_BYTES)
            if found is None:
                self.put(name, data)
            return data if found is None else found

    def flush(self) -> None:
        """Flush to disk the files that were written with ``sync=False``, and their folders."""
        with wrap_write_errors(self.root):
            flush_all(self.root)

    def delete(self, names: Iterable[str]) -> None:
        """Delete files, without an error for files that do not exist."""
        folders = set()
        for path in (self.root / name for name in names):
            with wrap_write_errors(path):
                path.unlink(missing_ok=True)
            folders.add(path.parent)
        for folder in (folder for folder in folders if folder.is_dir()):
            with wrap_write_errors(folder):
                flush_folder(folder)

    def lock(
        self, name: str, busy: GlsimError, *, wait: bool = False, shared: bool = False
    ) -> AbstractContextManager[None]:
        """Hold a file lock during a block, see ``lock.locked``. Object storage holds no locks."""
        file = self.root / name
        with wrap_write_errors(self.root):
            file.parent.mkdir(parents=True, exist_ok=True)
        return locked(file, busy, wait=wait, shared=shared)
