"""Where the files of a data set live: in a folder of a disk, or in object storage."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from typing import IO, Protocol, TypeVar

from glsim.errors import GlsimError
from glsim.files.atomic import AtomicFile
from glsim.files.cloud import cloud_url
from glsim.files.disk import Disk
from glsim.files.object_store import ObjectStore

_A = TypeVar("_A")
_B = TypeVar("_B")


class Store(Protocol):
    """A place for files that are whole or absent. It is cheap to send to other processes.

    The name of a file is its path in the store, with slashes; it leads out of the store neither by
    ".." nor by links. Every method raises DatasetError, which names the file, for what fails.
    """

    @property
    def is_remote(self) -> bool:
        """Whether each read takes a request over the network."""
        ...

    def where(self, name: str) -> str:
        """Return the path or the URL of a file, for messages."""
        ...

    def names(self, folder: str) -> list[str]:
        """List the entries of a folder, sorted; empty if there is no such folder."""
        ...

    def size(self, name: str) -> int | None:
        """Return the size of a file, bytes; None if there is none."""
        ...

    def checksum(self, name: str) -> dict[str, int] | None:
        """Return the size and CRC32 of a file; None if there is none."""
        ...

    def read(self, name: str, limit: int) -> bytes | None:
        """Read a file of at most ``limit`` bytes; None if there is none."""
        ...

    def read_range(self, name: str, start: int, size: int) -> bytes:
        """Read ``size`` bytes of a file from ``start``; fewer if it ends before."""
        ...

    def open(self, name: str) -> IO[bytes]:
        """Open a file for reading; of a remote one, a temporary copy."""
        ...

    def local(self, name: str, expected: dict[str, int] | None, key: str) -> Path:
        """Return a file of this machine with the bytes of ``name``; a remote one is copied.

        Args:
            name: the file.
            expected: its size and CRC32; a copy that has them is used again.
            key: names the version of the data set whose copies are kept together.
        """
        ...

    def map(self, function: Callable[[_A], _B], items: Iterable[_A]) -> Iterator[_B]:
        """Call a function that reads the store for each item, in order; remote, several at once."""
        ...

    def writing(self, folder: str) -> AbstractContextManager[Store]:
        """Return the store for a block that writes; ``folder`` holds its temporary files."""
        ...

    def create(self, name: str, *, sync: bool = True) -> AbstractContextManager[AtomicFile]:
        """Open a new file for writing, which appears when the block ends without an error.

        Args:
            name: the file; one of that name is replaced.
            sync: flush it to the disk at once, and not by ``flush``.
        """
        ...

    def put(self, name: str, data: bytes, *, sync: bool = True) -> dict[str, int]:
        """Write a whole file; return its size and CRC32. Arguments as for ``create``."""
        ...

    def put_first(self, name: str, data: bytes) -> bytes:
        """Write a file unless there is one; return the bytes that it has then."""
        ...

    def flush(self, names: Iterable[str]) -> None:
        """Flush files that were written with ``sync`` false."""
        ...

    def delete(self, names: Iterable[str]) -> None:
        """Delete files, if they are there."""
        ...

    def lock(
        self, name: str, busy: GlsimError, *, wait: bool = False, shared: bool = False
    ) -> AbstractContextManager[None]:
        """Hold a lock for a block.

        Args:
            name: the file of the lock.
            busy: raised if another process holds it.
            wait: wait for the other process instead.
            shared: hold it together with others that do so; object storage cannot, and holds none.
        """
        ...


def open_store(place: Path | str) -> Store:
    """Return the store at a path, or at a URL such as s3://bucket/faces; nothing is read yet."""
    url = cloud_url(place)
    return Disk(Path(place)) if url is None else ObjectStore(url)
