"""Files of a data set in object storage (s3://, gs://, az://), by fsspec, with retries.

An object is complete or absent: a file is written on this machine's disk first, uploaded when it is
complete, and its checksum is compared with the stored object's. Temporary failures (a timeout, a
throttled request) are tried again here, by no library below, until GIVE_UP_S have passed; lasting
failures raise DatasetError at once.
"""

from __future__ import annotations

import base64
import logging
import os
import random
import re
import secrets
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from itertools import count, islice
from pathlib import Path
from threading import Lock
from typing import IO, Any, TypeVar

from isal import isal_zlib
from typing_extensions import override

from glsim.core.errors import AccessError, ConfigError, DatasetError, GlsimError, pip_install
from glsim.core.files.atomic import (
    AtomicFile,
    checksum,
    file_checksum,
    missing,
    temporary_folder,
    wrap_write_errors,
)
from glsim.core.files.cache_folder import cache_folder
from glsim.core.files.contents import text_hash
from glsim.core.files.store import MAX_FIRST_BYTES, Store

log = logging.getLogger(__name__)
_T = TypeVar("_T")
_A = TypeVar("_A")
_B = TypeVar("_B")

#: Scheme -> package that fsspec needs for it, for messages. "memory" is a store in this process.
_PACKAGES = {
    **dict.fromkeys(("s3", "s3a"), "s3fs"),
    **dict.fromkeys(("gs", "gcs"), "gcsfs"),
    **dict.fromkeys(("az", "abfs", "abfss"), "adlfs"),
    "memory": "fsspec",
}
#: A cloud URL, maybe after fsspec's caches ("blockcache::s3://..."). pathlib makes "s3:/bucket".
_URL = re.compile(rf"^((?:[a-z]+::)*(?:{'|'.join(_PACKAGES)})):/+(?=[^/])")
#: Another URL, such as "file:///data", or "s3://" without a bucket. One letter: a Windows drive.
_SCHEME = re.compile(r"^(?:[a-z]+::)*[A-Za-z][A-Za-z0-9+.-]+:(?:/|$)")
#: Seconds after its first failure in which a request is tried again, and least number of attempts,
#: since one attempt to upload a shard may take longer. Chosen.
GIVE_UP_S, _ATTEMPTS = 30.0, 3
#: Waiting time before the second attempt, seconds, which doubles five times.
FIRST_WAIT_S, _DOUBLINGS = 0.5, 5
#: Seconds in which a store answers, and bytes a second that it sends or takes at least. Chosen;
#: s3fs gives up a silent connection after 15 s, others after minutes.
_ANSWER_S, _SLOWEST_BYTES_S = 20.0, 1e5
#: Options of s3fs: botocore shall repeat no request.
_ONE_ATTEMPT = {"config_kwargs": {"retries": {"total_max_attempts": 1}}}
#: Errors that another attempt does not cure. ValueError: the store refused a name or an option.
_LASTING = (FileNotFoundError, FileExistsError, PermissionError, IsADirectoryError, ValueError)
#: Names of error classes of botocore and google.auth, neither of which is imported here.
_NO_ACCESS = ("NoCredentialsError", "DefaultCredentialsError", "PartialCredentialsError")
_BLOCK_BYTES = 1 << 24
#: Number of reads, each at most the second number of bytes from the one before, after which blocks
#: of the third number are read. Chosen: a larger first block is waited for longer.
_READS, _NEAR_BYTES, _AHEAD_BYTES = 3, 1 << 20, 1 << 21
#: Number of parallel requests: one request takes tens of milliseconds.
CONNECTIONS = 16
#: Largest object that S3 takes in one request (its documentation: 5 GB).
_MAX_PUT_BYTES = 5 * 1000**3
#: Number of attempts to upload a file if the stored object's checksum differs.
_UPLOADS = 3


def open_store(place: Path | str) -> Store:
    """Return the store of a path, or of a URL such as s3://bucket/faces, without reading it."""
    url = cloud_url(place)
    return Store(Path(place)) if url is None else CloudStore(url)


def cloud_url(path: Path | str) -> str | None:
    """Return the cloud URL in a path or text; None for a path on a local disk.

    Raises ConfigError for another URL, which would otherwise become a folder named "http:".
    """
    if match := _URL.match(str(path)):
        return f"{match[1]}://{str(path)[match.end() :]}"
    if _SCHEME.match(str(path)) and not Path(path).exists():
        raise ConfigError(
            f"{path}: is no URL that glsim reads or writes: name a folder, or a bucket as in "
            "s3://bucket/faces (also gs://, az://)"
        )
    return None


class CloudStore(Store):
    """A store in object storage, given by its URL; each process opens its own connection.

    Credentials and endpoints are the store's usual ones, such as AWS_PROFILE or AWS_ENDPOINT_URL in
    the environment. Methods raise ConfigError if the package for the scheme is not installed.
    """

    is_remote = True
    _warned_s = float("-inf")  # when this process last warned that a request failed

    def __init__(self, url: str, temporary: Path | None = None) -> None:
        self.url, self._temporary = url.rstrip("/"), temporary
        self._connected: tuple[int, Any, str, _OrderedReads] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_connected": None}

    def __str__(self) -> str:
        return self.url

    @override
    def names(self, folder: str) -> list[str]:
        def ask(fs: Any, path: str) -> list[str]:
            fs.invalidate_cache()
            entries = map(str, fs.ls(path, False, **_limit(fs)))
            return [entry.rstrip("/").rpartition("/")[2] for entry in entries]

        return sorted(self._try(folder, ask) or [])

    @override
    def size(self, name: str) -> int | None:
        def ask(fs: Any, path: str) -> int:
            fs.invalidate_cache()  # a cached listing may be older than the object
            return int(fs.info(path, **_limit(fs))["size"])

        return self._try(name, ask)

    @override
    def checksum(self, name: str) -> dict[str, int] | None:
        """Return the size and CRC32 of an object; None if there is no such object."""
        # S3 has the CRC32 of an object that glsim uploaded. All bytes of other objects are read.

        def ask(fs: Any, path: str) -> dict[str, int] | None:
            if not hasattr(fs, "call_s3"):
                return None
            bucket, key, _ = fs.split_path(path)
            options = {"ChecksumMode": "ENABLED"} | _limit(fs)
            head = fs.call_s3("head_object", Bucket=bucket, Key=key, **options)
            code = head.get("ChecksumCRC32")
            if code is None or head.get("ChecksumType", "FULL_OBJECT") != "FULL_OBJECT":
                return None
            crc32 = int.from_bytes(base64.b64decode(code), "big")
            return {"size": int(head["ContentLength"]), "crc32": crc32}

        found = self._try(name, ask)
        if found is not None or (size := self.size(name)) is None:
            return found
        crc32 = 0
        for block in self._blocks(name, size):
            crc32 = isal_zlib.crc32(block, crc32)
        return {"size": size, "crc32": crc32}

    @override
    def read(self, name: str, limit: int) -> bytes | None:
        size = self.size(name)
        if size is not None and size > limit:
            raise DatasetError(
                f"{self.where(name)}: {size / 1e6:.0f} MB are above the {limit / 1e6:.3g} allowed"
            )
        return None if size is None else self.read_range(name, 0, size)

    @override
    def read_range(self, name: str, start: int, size: int) -> bytes:
        if size == 0:
            return b""
        reads = self._connect()[2]
        with reads.lock:
            if reads.are_in_order(name, start, size):
                data = self._try(name, partial(reads.read, start, size, self.after.get(name)))
                if data is not None:
                    return data
        part = {"start": start, "end": start + size}
        data = self._try(name, lambda fs, path: fs.cat_file(path, **part, **_limit(fs, size)))
        if data is None:
            raise missing(self.where(name))
        return bytes(data)

    def _blocks(self, name: str, size: int | None) -> Iterator[bytes]:
        """Yield the bytes of an object in blocks, so that memory does not grow with its size."""
        if size is None:
            raise missing(self.where(name))
        starts = range(0, size, _BLOCK_BYTES)
        return (self.read_range(name, at, min(_BLOCK_BYTES, size - at)) for at in starts)

    @override
    def open(self, name: str) -> IO[bytes]:
        blocks = self._blocks(name, self.size(name))
        file = tempfile.TemporaryFile()  # noqa: SIM115 (the caller closes it)
        file.writelines(blocks)
        file.seek(0)
        return file

    @override
    def local(self, name: str, expected: dict[str, int] | None, key: str) -> Path:
        file = cache_folder() / "cloud" / text_hash(f"{self.url} {key}") / name
        found = file_checksum(file)
        if found is not None and found == expected:
            return file
        size = self.size(name)
        if size is not None and expected is not None and size != expected["size"]:
            raise DatasetError(
                f"{self.where(name)}: was changed after it was written ({size} bytes, "
                f"{expected['size']} recorded): run glsim generate again with the same settings "
                "to repair it"
            )
        log.info("%s: copying it to %s", self.where(name), file.parent)
        with AtomicFile(file, sync=False) as copy:
            for block in self._blocks(name, size):
                copy.write(block)
        return file

    @override
    def map(self, function: Callable[[_A], _B], items: Iterable[_A]) -> Iterator[_B]:
        items = iter(items)
        pool = ThreadPoolExecutor(CONNECTIONS)
        try:
            while batch := list(islice(items, 4 * CONNECTIONS)):
                yield from pool.map(function, batch)
        finally:
            pool.shutdown(cancel_futures=True)  # after an error, wait for no further requests

    @override
    @contextmanager
    def writing(self, folder: str) -> Iterator[Store]:
        with temporary_folder() as temporary:
            yield CloudStore(self.url, temporary)

    @override
    @contextmanager
    def create(self, name: str, *, sync: bool = True) -> Iterator[AtomicFile]:
        assert self._temporary is not None, "writes in the block of writing() only"
        local = self._temporary / f"{secrets.token_hex(8)}-{name.rpartition('/')[2]}"
        with AtomicFile(local, sync=False) as file:
            yield file

        def send(fs: Any, path: str) -> None:
            fs.put_file(str(local), path, **_options(fs, file.size))

        for _ in range(_UPLOADS):
            self._write(name, send)
            if self.checksum(name) == file.checksum:
                break
        else:
            raise DatasetError(f"{self.where(name)}: did not arrive as it was sent: run it again")
        with wrap_write_errors(local):
            local.unlink()

    @override
    def put(self, name: str, data: bytes, *, sync: bool = True) -> dict[str, int]:
        self._write(name, lambda fs, path: fs.pipe_file(path, data, **_options(fs, len(data))))
        return checksum(data)

    @override
    def put_first(self, name: str, data: bytes) -> bytes:
        def send(fs: Any, path: str) -> bool:
            try:
                fs.pipe_file(path, data, mode="create", **_limit(fs, len(data)))
            except FileExistsError:
                return False
            return True

        while not self._write(name, send):
            if (found := self.read(name, MAX_FIRST_BYTES)) is not None:
                return found
        return data

    @override
    def flush(self) -> None:
        """Do nothing, because an uploaded object is stored already."""

    @override
    def delete(self, names: Iterable[str]) -> None:
        def remove(fs: Any, path: str) -> None:
            fs.rm_file(path, **_limit(fs))

        list(self.map(lambda name: self._try(name, remove), names))

    @override
    def lock(
        self, name: str, busy: GlsimError, *, wait: bool = False, shared: bool = False
    ) -> AbstractContextManager[None]:
        """Hold no lock, because parallel runs write the same bytes."""
        return nullcontext()

    def _connect(self) -> tuple[Any, str, _OrderedReads]:
        """Return fsspec's file system, the path in it and its reads; connect again after a fork."""
        if self._connected is None or self._connected[0] != os.getpid():
            scheme = self.url.split("://")[0].split("::")[-1]
            package = _PACKAGES[scheme]
            try:
                from fsspec.core import url_to_fs

                options = {scheme: dict(_ONE_ATTEMPT)} if package == "s3fs" else {}
                fs, path = url_to_fs(self.url, **options)
                fs.retries = 1  # of s3fs, which repeats requests itself
            except ImportError:
                raise ConfigError(
                    f"{self.url}: needs the package {package}: {pip_install('cloud')}"
                    + ("" if package in ("s3fs", "fsspec") else f" {package}")
                ) from None
            except ValueError as error:
                raise ConfigError(f"{self.url}: {_one_line(error)}") from None
            self._connected = os.getpid(), fs, str(path).rstrip("/"), _OrderedReads()
        return self._connected[1:]

    def _write(self, name: str, call: Callable[[Any, str], _T]) -> _T:
        """Call like ``_try``, but raise DatasetError if the bucket does not exist."""
        try:
            return self._attempt(name, call)
        except FileNotFoundError:
            raise DatasetError(
                f"cannot write {self.where(name)}: there is no such bucket: create it, or name "
                "another"
            ) from None

    def _try(self, name: str, call: Callable[[Any, str], _T]) -> _T | None:
        """Call a function with the file system and an object's path; None if there is no object."""
        try:
            return self._attempt(name, call)
        except FileNotFoundError:
            return None

    def _attempt(self, name: str, call: Callable[[Any, str], _T]) -> _T:
        fs, root, _ = self._connect()
        give_up_s = float("inf")
        for attempt in count():
            try:
                return call(fs, f"{root}/{name}" if name else root)
            except FileNotFoundError:
                raise
            except Exception as error:
                lasting = isinstance(error, _LASTING) or type(error).__name__ in _NO_ACCESS
                # Random waiting times, so that throttled workers do not try again together.
                wait_s = FIRST_WAIT_S * 2 ** min(attempt, _DOUBLINGS) * random.uniform(0.5, 1)
                now_s = time.monotonic()
                give_up_s = min(give_up_s, now_s + GIVE_UP_S)
                if lasting or (attempt + 1 >= _ATTEMPTS and now_s + wait_s > give_up_s):
                    advice = (
                        "check the credentials and what they allow"
                        if lasting
                        else "what is complete is kept: run the same command again"
                    )
                    kind = AccessError if lasting else DatasetError
                    raise kind(f"{self.where(name)}: {_one_line(error)}: {advice}") from error
                if now_s - CloudStore._warned_s > GIVE_UP_S:  # many requests fail together
                    CloudStore._warned_s = now_s
                    again = f"trying again for {GIVE_UP_S:.0f} s"
                    log.warning("%s: %s: %s", self.where(name), _one_line(error), again)
                time.sleep(wait_s)
        raise AssertionError("an attempt returns or raises")


class _OrderedReads:
    """Reads near each other, from blocks of open files; the next block and file come in advance.

    A request over a network takes longer than the decoding of a frame. ``lock`` guards the methods.
    """

    def __init__(self) -> None:
        self.lock, self._thread = Lock(), ThreadPoolExecutor(1)
        self._name, self._end, self._count = "", 0, 0
        self._files: dict[str, Future[Any]] = {}  # by path

    def are_in_order(self, name: str, start: int, size: int) -> bool:
        """Note a read; whether it and some before are near each other, or it begins an object."""
        same = name == self._name
        near = abs(start - (self._end if same else 0)) <= _NEAR_BYTES
        self._count = self._count + 1 if near and (same or self._count >= _READS) else 0
        self._name, self._end = name, start + size
        return self._count >= _READS

    def read(self, start: int, size: int, after: str | None, fs: Any, path: str) -> bytes:
        """Read a part of an object, and open the object ``after`` it."""
        paths = [path] if after is None else [path, path.removesuffix(self._name) + after]
        files, submit = self._files, self._thread.submit
        self._files = {p: files.get(p) or submit(_open_in_blocks, fs, p) for p in paths}
        opened = self._files.pop(path)  # a file that fails is opened again
        file = opened.result(_ANSWER_S + _AHEAD_BYTES / _SLOWEST_BYTES_S)
        file.seek(start)
        data = bytes(file.read(size))
        self._files[path] = opened
        return data


def _open_in_blocks(fs: Any, path: str) -> Any:
    """Open an object and read its first block."""
    options = {"cache_type": "background", "cache_options": {"maxblocks": 3}}
    file = fs.open(path, "rb", block_size=_AHEAD_BYTES, **options)
    file.read(1)
    return file


def _limit(fs: Any, size: int = 0) -> dict[str, Any]:
    """Return fsspec's option of a time limit for a request of ``size`` bytes."""
    limited = type(fs).async_impl  # not the store in memory
    return {"timeout": _ANSWER_S + size / _SLOWEST_BYTES_S} if limited else {}


def _options(fs: Any, size: int) -> dict[str, Any]:
    """Return upload options: S3 shall check the received bytes and store their CRC32."""
    options = _limit(fs, size)
    if hasattr(fs, "call_s3"):
        options["ChecksumAlgorithm"] = "CRC32"
        if size < _MAX_PUT_BYTES:
            options["chunksize"] = _MAX_PUT_BYTES  # in one part: S3 stores its CRC32
    return options


def _one_line(error: Exception) -> str:
    nothing = "no answer" if isinstance(error, TimeoutError) else type(error).__name__
    return " ".join(str(error).split())[:300] or nothing
