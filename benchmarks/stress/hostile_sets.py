"""Data sets made to do harm: each takes a sound one and changes it, with checksums that fit.

A set lies in ``BOX/set``; what it must not reach lies in ``BOX/outside``.
"""

from __future__ import annotations

import io
import json
import os
import socket
import struct
import tarfile
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from glsim.dataset.disk_format import HEADER, MANIFEST, STATE
from glsim.files.atomic import checksum, file_checksum
from tests.support.dataset_fakes import make, make_settings, make_tasks, sign

#: Changes the set in a folder.
Change = Callable[[Path], None]

_IMAGE = "train/s000/smile.1_00000_noisy.png"
_SHARD = "train-000000.tar"
_INDEX = f"{STATE}/chunks.jsonl"


def make_box(box: Path, format: str) -> None:
    """Write a sound data set, and beside it the files that no reader may read."""
    make(box / "set", make_settings(format=format), make_tasks(4, 3))
    outside = box / "outside"
    outside.mkdir()
    source = box / "set" / (_IMAGE if format == "png" else _SHARD)
    for name in ("map.png", "shard.tar"):
        (outside / name).write_bytes(source.read_bytes())
    for name in (HEADER, MANIFEST):
        (outside / name).write_bytes((box / "set" / name).read_bytes())
    (outside / "chunks.jsonl").write_bytes((box / "set" / _INDEX).read_bytes())
    os.mkfifo(outside / "pipe")


def _record(root: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change the first record of the manifest."""
    path = root / MANIFEST
    first, _, rest = path.read_text().partition("\n")
    record = json.loads(first)
    change(record)
    path.write_text(f"{json.dumps(record)}\n{rest}")
    sign(root)


def _file(root: Path, **changes: Any) -> None:
    _record(root, lambda record: record["files"]["noisy"].update(changes))


def _name(name: object) -> Change:
    return lambda root: _file(root, name=name)


def _put(root: Path, file: str, put: Callable[[Path], object]) -> None:
    path = root / file
    path.unlink(missing_ok=True)
    put(path)


def _link(file: str, target: str) -> Change:
    return lambda root: _put(root, file, lambda path: path.symlink_to(target))


def _pipe(file: str) -> Change:
    return lambda root: _put(root, file, os.mkfifo)


def _folder(file: str) -> Change:
    return lambda root: _put(root, file, Path.mkdir)


def _socket(root: Path) -> None:
    (root / _IMAGE).unlink()
    there = Path.cwd()
    os.chdir((root / _IMAGE).parent)  # names of sockets are short
    try:
        socket.socket(socket.AF_UNIX).bind(Path(_IMAGE).name)
    finally:
        os.chdir(there)


def _move_out(root: Path, folder: str) -> None:
    """Put a folder outside, and a link in its place."""
    moved = root.parent / "outside" / "folder"
    (root / folder).rename(moved)
    (root / folder).symlink_to(moved)


def _outside_folder(root: Path) -> None:
    """Replace the folder of the split test by a link to a folder outside the data set."""
    (root / "test").rename(root / "test-moved")
    (root / "test").symlink_to(root.parent / "outside")


def _image(root: Path, data: bytes, **intrinsics: int) -> None:
    """Replace an image, its checksum, and the size that the record says."""
    (root / _IMAGE).write_bytes(data)

    def change(record: dict[str, Any]) -> None:
        record["files"]["noisy"].update(checksum(data))
        record["intrinsics"].update(intrinsics)

    _record(root, change)


def _png(width: int, height: int, colour: int = 0, more: bytes = b"") -> bytes:
    """Return a PNG of zeros in 16 bits, at most 8192 rows; colour 0 is grey, 6 four channels."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return (
            struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
        )

    row = bytes(1 + 2 * width * (4 if colour == 6 else 1))
    packer = zlib.compressobj(1)
    data = b"".join(packer.compress(row) for _ in range(min(height, 8192))) + packer.flush()
    header = struct.pack(">IIBBBBB", width, height, 16, colour, 0, 0, 0)
    parts = (chunk(b"IHDR", header), more, chunk(b"IDAT", data), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def _text_bomb() -> bytes:
    """Return a PNG with a comment (chunk zTXt) that decompresses to 600 MB."""
    packer = zlib.compressobj(1)
    text = b"".join(packer.compress(bytes(10**6)) for _ in range(600)) + packer.flush()
    data = b"Comment\0\0" + text
    comment = struct.pack(">I", len(data)) + b"zTXt" + data
    return _png(20, 18, more=comment + struct.pack(">I", zlib.crc32(b"zTXt" + data)))


def _tiff(sides: list[tuple[int, int, int]], pixels: int) -> bytes:
    """Return a compressed 16-bit TIFF of zeros.

    Args:
        sides: entries (tag, type, value) of the width (tag 256) and the height (257), in pixels.
        pixels: number of pixels in its data.
    """
    data = zlib.compress(bytes(2 * pixels), 9)
    tags = [(258, 3, 16), (259, 3, 8), (262, 3, 1), (273, 4, 8), (277, 3, 1)]
    tags += [(278, 4, 2**31 - 1), (279, 4, len(data)), *sides]
    at = 8 + len(data)
    directory = struct.pack("<H", len(tags))
    for tag, kind, value in sorted(tags, key=lambda entry: entry[0]):
        directory += struct.pack("<HHII", tag, kind, 1, value)
    return b"II*\0" + struct.pack("<I", at) + data + directory + bytes(4)


def _two_sizes(root: Path) -> None:
    """A TIFF that states its size twice: some readers take the first, some the last."""
    sides = [(256, 3, 20000), (256, 3, 20), (257, 3, 20000), (257, 3, 18)]
    _image(root, _tiff(sides, 20000 * 2000))


def _header(root: Path, **changes: Any) -> None:
    sign(root, **changes)


def _header_text(root: Path, text: str | bytes) -> None:
    data = text.encode() if isinstance(text, str) else text
    (root / HEADER).write_bytes(data)
    index = root / _INDEX
    lines = index.read_text().splitlines()[:-1]
    index.write_text("\n".join([*lines, json.dumps(checksum(data))]) + "\n")


def _with_step(root: Path, step: str) -> str:
    text = (root / HEADER).read_text()
    return text.replace('"depth_unit_mm": 1.0', f'"depth_unit_mm": {step}')


def _repeated_key(root: Path) -> None:
    text = (root / HEADER).read_text()
    _header_text(root, text.rstrip()[:-1] + ', "depth_unit_mm": 10.0}')


def _many_keys(root: Path, count: int) -> None:
    text = (root / HEADER).read_text().rstrip()[:-1]
    _header_text(root, text + "".join(f',"k{number}":{{}}' for number in range(count)) + "}")


def _sparse(file: str, size: int) -> Change:
    def change(root: Path) -> None:
        with (root / file).open("r+b") as opened:
            opened.truncate(size)

    return change


def _counts(root: Path, **frames: int) -> None:
    header = json.loads((root / HEADER).read_text())
    sign(root, frames=header["frames"] | frames)


def _manifest_text(root: Path, change: Callable[[list[str]], list[str]]) -> None:
    path = root / MANIFEST
    path.write_text("".join(change(path.read_text().splitlines(keepends=True))))
    sign(root)


def _first_line(line: str) -> Change:
    return lambda root: _manifest_text(root, lambda lines: [line + "\n", *lines[1:]])


def _repeated_file(root: Path) -> None:
    def change(lines: list[str]) -> list[str]:
        again = ',"files":{"clean":{"name":"/etc/passwd","size":1,"crc32":1}}}\n'
        return [lines[0].rstrip()[:-1] + again, *lines[1:]]

    _manifest_text(root, change)


def _shard(root: Path, *members: tuple[str, bytes, int]) -> None:
    """Add members (name, type, stated size) to a shard: plain files have zeros."""
    path = root / _SHARD
    old, new = io.BytesIO(path.read_bytes()), io.BytesIO()
    with tarfile.open(fileobj=old) as source, tarfile.open(fileobj=new, mode="w") as target:
        for member in source:
            target.addfile(member, source.extractfile(member))
        for name, kind, size in members:
            info = tarfile.TarInfo(name)
            info.type, info.size, info.linkname = kind, size, "../outside/map.png"
            target.fileobj.write(info.tobuf())
    path.write_bytes(new.getvalue())
    header = json.loads((root / HEADER).read_text())
    sign(root, files=header["files"] | {_SHARD: file_checksum(path)})


def _large_shard(root: Path) -> None:
    """Write a shard of 5 GB, nearly all holes, and a record of an image that is as large.

    A virtual machine may need 2.4 s of processor time to read 1 GB of holes for the first time.
    """
    size = 5 * 10**9  # more than 32 bits count
    _sparse(_SHARD, size)(root)
    header = json.loads((root / HEADER).read_text())
    sign(root, files=header["files"] | {_SHARD: {"size": size, "crc32": 0}})
    _file(root, size=size - 10**6, offset=0)


_BIG = np.iinfo(np.int64).max
#: Format -> name -> change.
SETS: dict[str, dict[str, Change]] = {
    "png": {
        "name ../": _name("../outside/map.png"),
        "name inside/../..": _name("train/../../outside/map.png"),
        "name absolute": lambda root: _file(root, name=str(root.parent / "outside" / "map.png")),
        "name of a device": _name("/dev/zero"),
        "name with NUL": _name("train/a\0b.png"),
        "name empty": _name(""),
        "name of a folder": _name("train"),
        "name too long": _name("x" * 5000),
        "name with line feed": _name("train/a\nglsim: error: fine\x1b[2J.png"),
        "name no text": _name(["../outside/map.png"]),
        "image links out": _link(_IMAGE, "../../../outside/map.png"),
        "image links to a device": _link(_IMAGE, "/dev/zero"),
        "image links to a pipe": _link(_IMAGE, "../../../outside/pipe"),
        "image links to itself": _link(_IMAGE, Path(_IMAGE).name),
        "image is a pipe": _pipe(_IMAGE),
        "image is a folder": _folder(_IMAGE),
        "image is a socket": _socket,
        "subject links out": partial(_move_out, folder="train/s000"),
        "split links out": partial(_move_out, folder="train"),
        "split links to others": _outside_folder,
        "state links out": partial(_move_out, folder=STATE),
        "manifest links out": _link(MANIFEST, f"../outside/{MANIFEST}"),
        "manifest is a pipe": _pipe(MANIFEST),
        "manifest is a folder": _folder(MANIFEST),
        "manifest is a device": _link(MANIFEST, "/dev/zero"),
        "header links out": _link(HEADER, f"../outside/{HEADER}"),
        "header is a pipe": _pipe(HEADER),
        "header is a device": _link(HEADER, "/dev/zero"),
        "index links out": _link(_INDEX, "../../outside/chunks.jsonl"),
        "index is a pipe": _pipe(_INDEX),
        "subject ../../..": lambda root: _record(root, lambda r: r.update(subject="../../..")),
        "sequence absolute": lambda root: _record(root, lambda r: r.update(sequence="/etc")),
        "header deep": lambda root: _header_text(root, '{"a":' * 10**6),
        "header long number": lambda root: _header_text(root, '{"frames":' + "9" * 10**6 + "}"),
        "header of a million keys": partial(_many_keys, count=10**6),
        "header of 3 million keys": partial(_many_keys, count=3 * 10**6),
        "header repeats a key": _repeated_key,
        "header of 20 GB": _sparse(HEADER, 2 * 10**10),
        "header no text": lambda root: _header_text(root, b"\xff\xfe" + bytes(range(256)) * 40),
        "frames of other splits": lambda root: _counts(root, train=3, val=6),
        "frames too many": lambda root: _counts(root, train=10**12),
        "frames negative": lambda root: _counts(root, train=-6),
        "layer unknown": lambda root: _header(
            root, settings={"output": {"layers": ["noisy", "../x"], "format": "png"}}
        ),
        "step NaN": lambda root: _header_text(root, _with_step(root, "NaN")),
        "record deep": _first_line("[" * 500_000),
        "record long number": _first_line('{"index":' + "9" * 500_000 + "}"),
        "record of 100 MB": _first_line("x" * 10**8),
        "record repeats a key": _repeated_file,
        "records twice": lambda root: _manifest_text(
            root, lambda lines: [lines[0], lines[0], *lines[2:]]
        ),
        "records of 100 million lines": lambda root: _manifest_text(
            root, lambda lines: [*lines, "\n" * 10**8]
        ),
        "camera of 10^9 pixels": lambda root: _record(
            root, lambda r: r["intrinsics"].update(width=10**9, height=10**9)
        ),
        "image of 32,000 x 32,000": lambda root: _image(root, _png(32000, 32000)),
        "image of 8,192 x 8,192": lambda root: _image(
            root, _png(8192, 8192), width=8192, height=8192
        ),
        "image of four channels": lambda root: _image(root, _png(8192, 8192, colour=6)),
        "image with a comment of 600 MB": lambda root: _image(root, _text_bomb()),
        "image with two sizes": _two_sizes,
    },
    "webdataset": {
        "offset negative": lambda root: _file(root, offset=-1),
        "offset behind the end": lambda root: _file(root, offset=2**52),
        "offset too large": lambda root: _file(root, offset=10**30),
        "size too large": lambda root: _file(root, size=_BIG),
        "shard of 5 GB": _large_shard,
        "shard named ../": _name("../outside/shard.tar"),
        "shard links out": _link(_SHARD, "../outside/shard.tar"),
        "shard is a pipe": _pipe(_SHARD),
        "member ../": lambda root: _shard(root, ("../../outside/x", tarfile.REGTYPE, 0)),
        "member links out": lambda root: _shard(root, ("link", tarfile.SYMTYPE, 0)),
        "member of 10^11 bytes": lambda root: _shard(root, ("large", tarfile.REGTYPE, 10**11)),
        "member is a device": lambda root: _shard(root, ("zero", tarfile.CHRTYPE, 0)),
    },
}  # fmt: skip
