"""A PNG encoder for depth maps: ISA-L's deflate in the smallest container.

OpenCV takes 0.7 ms for a 512 x 424 frame that holds a face, nearly all of it in zlib; ISA-L takes
0.1 ms and makes smaller files, and no filter of PNG's pays for its time here.

PNG: W3C Recommendation, third edition.
"""

from __future__ import annotations

import struct
import zlib

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY = 0
_NO_FILTER = 0
_LEVEL = 1  # of ISA-L: 2 takes the same time and saves 0.1 %


def encode_png(image: NDArray[np.uint16] | NDArray[np.uint8]) -> bytes:
    """(H, W) uint16 or uint8 to the bytes of a grey PNG file. The same image, the same bytes."""
    height, width = image.shape
    samples = np.ascontiguousarray(image, image.dtype.newbyteorder(">")).view(np.uint8)
    rows = np.empty((height, 1 + samples.shape[1]), np.uint8)
    rows[:, 0] = _NO_FILTER
    rows[:, 1:] = samples
    header = struct.pack(">IIBBBBB", width, height, image.dtype.itemsize * 8, _GREY, 0, 0, 0)
    stream = isal_zlib.compress(rows, _LEVEL)
    chunks = [_chunk(b"IHDR", header), _chunk(b"IDAT", stream), _chunk(b"IEND", b"")]
    return b"".join([_SIGNATURE, *chunks])


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))
