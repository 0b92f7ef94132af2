"""Folders in object storage (s3://, gs://, az://), through fsspec: read, write, list, with retries.

An object appears whole or not at all, so there are no temporary names here. What fails for a moment
(a timeout, a throttled request) is tried again; what cannot succeed is a DatasetError at once.
"""

from __future__ import annotations

import base64
import logging
import os
import random
import re
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

from isal import isal_zlib

from glsim.errors import ConfigError, DatasetError
from glsim.files.atomic import AtomicFile, missing

log = logging.getLogger(__name__)
_T = TypeVar("_T")

#: The package that fsspec needs for each scheme, for messages. "memory" lies in this process.
_PACKAGES = {
    **dict.fromkeys(("s3", "s3a"), "s3fs"),
    **dict.fromkeys(("gs", "gcs"), "gcsfs"),
    **dict.fromkeys(("az", "abfs", "abfss"), "adlfs"),
    "memory": "fsspec",
}
#: A URL, also with fsspec's caches before it ("blockcache::s3://..."), and also as pathlib writes
#: it, which joins the slashes: s3:/bucket.
_URL = re.compile(rf"^((?:[a-z]+::)*(?:{'|'.join(_PACKAGES)})):/+(?=[^/])")
#: What was meant as a URL: "file:///data", "s3://" without a bucket. One letter is a Windows drive.
_SCHEME = re.compile(r"^(?:[a-z]+::)*[A-Za-z][A-Za-z0-9+.-]+:(?:/|$)")
#: Seconds before each further attempt, doubling as every store asks for: half a minute in all.
RETRY_AFTER_S: tuple[float, ...] = (0.5, 1, 2, 4, 8, 16)
#: Errors that another attempt does not change. ValueError: a name or an option that is refused.
_LASTING = (FileNotFoundError, FileExistsError, PermissionError, IsADirectoryError, ValueError)
#: Classes of botocore and google.auth, by name because neither is imported here.
_NO_ACCESS = ("NoCredentialsError", "DefaultCredentialsError", "PartialCredentialsError")
_BLOCK_BYTES = 1 << 24
#: Requests at the same time where there are many: each takes tens of milliseconds.
CONNECTIONS = 16
#: Largest object that S3 takes in one request (its documentation: 5 GB).
_MAX_PUT_BYTES = 5 * 1000**3


def cloud_url(path: Path | str) -> str | None:
    """Return the URL that a path gives; None for a path on this machine's disks.

    Raises ConfigError for a URL of another kind: it would become a folder that is called "http:".
    """
    if match := _URL.match(str(path)):
        return f"{match[1]}://{str(path)[match.end() :]}"
    if _SCHEME.match(str(path)) and not Path(path).exists():
        raise ConfigError(
            f"{path}: is no URL that glsim reads or writes: name a folder, or a bucket as in "
            "s3://bucket/faces (also gs://, az://)"
        )
    return None


class CloudFolder:
    """A folder (a prefix) of a store. Cheap to send to other processes, which connect on their own.

    Names are relative to it. Credentials and endpoints are the store's usual ones, such as
    AWS_PROFILE or AWS_ENDPOINT_URL in the environment. Methods raise ConfigError if the package for
    the scheme is not installed, and DatasetError for what the store refuses.
    """

    def __init__(self, url: str) -> None:
        self.url = url.rstrip("/")
        self._connected: tuple[int, Any, str] | None = None

    def __getstate__(self) -> dict[str, Any]:
        return {"url": self.url, "_connected": None}

    def __str__(self) -> str:
        return self.url

    def where(self, name: str) -> str:
        """Return the URL of an object."""
        return f"{self.url}/{name}"

    def read(self, name: str, limit: int) -> bytes | None:
        """Read a whole object of at most ``limit`` bytes; None if there is none."""
        size = self.size(name)
        if size is None:
            return None
        if size > limit:
            raise DatasetError(
                f"{self.where(name)}: {size / 1e6:.0f} MB are more than the {limit / 1e6:.3g} "
                "allowed"
            )
        return self.read_range(name, 0, size)

    def read_range(self, name: str, start: int, size: int) -> bytes:
        """Read bytes of an object; fewer if it ends before. DatasetError if there is none."""
        if size == 0:
            return b""
        data = self._try(name, lambda fs, path: fs.cat_file(path, start=start, end=start + size))
        if data is None:
            raise missing(self.where(name))
        return bytes(data)

    def size(self, name: str) -> int | None:
        """Return the size of an object, bytes; None if there is none. It is asked for by name."""

        def ask(fs: Any, path: str) -> int:
            fs.invalidate_cache()  # of listings, which may be older than the object
            return int(fs.info(path)["size"])

        return self._try(name, ask)

    def download(self, name: str, file: Path) -> bool:
        """Copy an object to a file; return whether there is one."""
        size = self.size(name)
        if size is None:
            return False
        with AtomicFile(file, sync=False) as copy:
            for block in self.blocks(name, size):
                copy.write(block)
        return True

    def blocks(self, name: str, size: int | None = None) -> Iterator[bytes]:
        """Yield the bytes of an object in blocks, so that memory does not grow with it."""
        end = self.size(name) if size is None else size
        for start in range(0, end or 0, _BLOCK_BYTES):
            yield self.read_range(name, start, min(_BLOCK_BYTES, (end or 0) - start))

    def checksum(self, name: str) -> dict[str, int] | None:
        """Return the size and CRC32 of an object's bytes; None if there is none.

        S3 computes the CRC32 of what it holds when it takes an object; elsewhere, and for objects
        that others put there, all bytes are read.
        """

        def ask(fs: Any, path: str) -> dict[str, int] | None:
            if not hasattr(fs, "call_s3"):
                return None
            bucket, key, _ = fs.split_path(path)
            head = fs.call_s3("head_object", Bucket=bucket, Key=key, ChecksumMode="ENABLED")
            code = head.get("ChecksumCRC32")
            if code is None or head.get("ChecksumType", "FULL_OBJECT") != "FULL_OBJECT":
                return None
            crc32 = int.from_bytes(base64.b64decode(code), "big")
            return {"size": int(head["ContentLength"]), "crc32": crc32}

        found = self._try(name, ask)
        size = None if found is not None else self.size(name)
        if size is None:
            return found
        crc32 = 0
        for block in self.blocks(name, size):
            crc32 = isal_zlib.crc32(block, crc32)
        return {"size": size, "crc32": crc32}

    def names(self, prefix: str) -> list[str]:
        """List the names of the objects directly in a sub-folder; a store's list may lag."""

        def ask(fs: Any, path: str) -> list[str]:
            fs.invalidate_cache()
            return [
                str(entry).rstrip("/").rpartition("/")[2] for entry in fs.ls(path, detail=False)
            ]

        return sorted(self._try(prefix, ask) or [])

    def write(self, name: str, data: bytes) -> None:
        """Write an object; one of that name is replaced."""
        self._write(name, lambda fs, path: fs.pipe_file(path, data, **_checked(fs)))

    def upload(self, name: str, file: Path) -> None:
        """Write a file's bytes as an object; one of that name is replaced."""

        def send(fs: Any, path: str) -> None:
            options: dict[str, Any] = _checked(fs)
            if options and file.stat().st_size < _MAX_PUT_BYTES:
                options["chunksize"] = _MAX_PUT_BYTES  # one request: S3 keeps its CRC32
            fs.put_file(str(file), path, **options)

        self._write(name, send)

    def write_new(self, name: str, data: bytes) -> bool:
        """Write an object if there is none of that name; return whether it was written.

        One of several processes that do so at the same time gets True. After a lost answer the
        object may be there though this returns False: compare its content.
        """

        def send(fs: Any, path: str) -> bool:
            try:
                fs.pipe_file(path, data, mode="create")
            except FileExistsError:
                return False
            return True

        return bool(self._write(name, send))

    def delete(self, names: Iterable[str]) -> None:
        """Delete objects; those that are not there are left out."""
        with ThreadPoolExecutor(CONNECTIONS) as pool:
            list(pool.map(lambda name: self._try(name, lambda fs, path: fs.rm_file(path)), names))

    # ---------------------------------------------------------------- connection and retries

    def _connect(self) -> tuple[Any, str]:
        """Return fsspec's file system and our path in it; connections do not survive a fork."""
        if self._connected is None or self._connected[0] != os.getpid():
            package = _PACKAGES[self.url.split("://")[0].split("::")[-1]]
            try:
                from fsspec.core import url_to_fs

                fs, path = url_to_fs(self.url)
            except ImportError:
                raise ConfigError(
                    f"{self.url}: needs the package {package}: pip install 'glsim[cloud]'"
                    + ("" if package in ("s3fs", "fsspec") else f" {package}")
                ) from None
            except ValueError as error:
                raise ConfigError(f"{self.url}: {_one_line(error)}") from None
            self._connected = os.getpid(), fs, str(path).rstrip("/")
        return self._connected[1:]

    def _write(self, name: str, call: Callable[[Any, str], _T]) -> _T:
        """Call as ``_try``; a bucket that does not exist is an error."""
        try:
            return self._attempt(name, call)
        except FileNotFoundError:
            raise DatasetError(
                f"cannot write {self.where(name)}: there is no such bucket: create it, or name "
                "another"
            ) from None

    def _try(self, name: str, call: Callable[[Any, str], _T]) -> _T | None:
        """Call with the file system and an object's path; None if there is no such object."""
        try:
            return self._attempt(name, call)
        except FileNotFoundError:
            return None

    def _attempt(self, name: str, call: Callable[[Any, str], _T]) -> _T:
        fs, root = self._connect()
        for wait_s in (*RETRY_AFTER_S, None):
            try:
                return call(fs, f"{root}/{name}" if name else root)
            except FileNotFoundError:
                raise
            except Exception as error:
                lasting = isinstance(error, _LASTING) or type(error).__name__ in _NO_ACCESS
                if wait_s is None or lasting:
                    advice = (
                        "check the credentials and what they allow"
                        if lasting
                        else "what is complete is kept: run the same command again"
                    )
                    raise DatasetError(
                        f"{self.where(name)}: {_one_line(error)}: {advice}"
                    ) from error
                log.info("%s: %s: trying again", self.where(name), _one_line(error))
                # Jitter, so that workers that were throttled together do not come back together.
                time.sleep(wait_s * random.uniform(0.5, 1))
        raise AssertionError("the last attempt returns or raises")


def _checked(fs: Any) -> dict[str, Any]:
    """Return the options that let S3 check what it receives and keep the CRC32."""
    return {"ChecksumAlgorithm": "CRC32"} if hasattr(fs, "call_s3") else {}


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())[:300] or type(error).__name__
