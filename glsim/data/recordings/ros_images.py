"""Decode image messages of ROS: raw, and compressed without loss (PNG, RVL)."""

from __future__ import annotations

import re
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import DatasetError
from glsim.core.files.png import MAX_MAP_PX, decode_png

#: Encoding of one-channel images -> NumPy type without byte order.
TYPES = {
    "16UC1": "u2", "mono16": "u2", "Z16": "u2", "32FC1": "f4", "64FC1": "f8", "8UC1": "u1",
    "mono8": "u1",
}  # fmt: skip

#: Bit depth and colour type of a 16-bit grey PNG file; they follow its size.
_GREY_16 = b"\x10\x00"


def encoding_of(message: Any) -> str:
    """Return the encoding of an image; "" if it is unknown or compressed with loss."""
    if hasattr(message, "encoding"):
        return str(message.encoding)
    name, _, codec = str(message.format).partition(";")
    if name.strip().lower() == "png" and message.data[24:26].tobytes() == _GREY_16:
        return "16UC1"  # image_transport's name of a plain PNG file
    return name.strip() if re.search("compresseddepth|png", codec.lower()) else ""


def read_pixels(message: Any, where: str) -> NDArray[np.generic]:
    """Return the (H, W) pixels of an image message. Raises DatasetError."""
    encoding = encoding_of(message)
    kind = TYPES.get(encoding)
    if kind is not None and not hasattr(message, "encoding"):
        try:
            return _decompressed(bytes(message.data), kind)
        except (ValueError, IndexError, struct.error) as error:
            raise DatasetError(f"{where}: a {message.format} image is damaged ({error})") from None
    height, width, step = int(message.height), int(message.width), int(message.step)
    size = np.dtype(kind or "u1").itemsize
    if kind is None or width * height > MAX_MAP_PX or step < width * size:
        raise DatasetError(
            f"{where}: has images of {width}x{height} in the encoding {encoding!r:.40}; "
            f"glsim reads {', '.join(TYPES)} of at most {MAX_MAP_PX} pixels"
        )
    if len(message.data) < step * height or height * width == 0:
        raise DatasetError(f"{where}: an image of {width}x{height} is cut off")
    rows = np.asarray(message.data, np.uint8)[: step * height].reshape(height, step)
    order = ">" if message.is_bigendian else "<"
    pixels = np.ascontiguousarray(rows[:, : width * size]).view(f"{order}{kind}")
    return pixels.astype(np.dtype(kind))


def _decompressed(data: bytes, kind: str) -> NDArray[np.generic]:
    """Decode an image of compressed_depth_image_transport, or a PNG file. Raises ValueError.

    Data begin with a header of 12 bytes. Its floats a and b give metres: a / (code - b).
    """
    start = data.find(b"\x89PNG", 0, 16)
    codes = _decode_rvl(data[12:]) if start < 0 else decode_png(data[start:], MAX_MAP_PX)
    if codes is None or codes.ndim != 2 or codes.dtype != np.uint16:
        raise ValueError("no PNG or RVL of 16 bits")
    if kind == "u2":
        return codes
    a, b = struct.unpack_from("<ff", data, 4)
    with np.errstate(divide="ignore", invalid="ignore"):
        steps = codes.astype(np.float32)
        return np.where(steps > 0, a / (steps - np.float32(b)), 0).astype(np.float32)


def _decode_rvl(data: bytes) -> NDArray[np.uint16]:
    """Decode RVL: runs of zeros and of differences (Wilson 2017, Fast Lossless Depth Compression).

    A number is a row of nibbles, lowest first: three bits of value, and a top bit that is set if
    another nibble follows.
    """
    width, height = struct.unpack_from("<ii", data)
    if min(width, height) < 1 or width * height > MAX_MAP_PX:
        raise ValueError(f"an image of {width}x{height}")
    words = np.frombuffer(data, "<u4", (len(data) - 8) // 4, 8)
    nibbles = (words[:, None] >> np.arange(28, -1, -4, dtype=np.uint32) & 15).ravel()
    ends = np.flatnonzero(nibbles < 8)
    starts = np.r_[0, ends[:-1] + 1]
    places = np.arange(ends[-1] + 1) - np.repeat(starts, ends - starts + 1)
    bits = (nibbles[: ends[-1] + 1] & 7).astype(np.int64) << np.minimum(3 * places, 60)
    numbers = np.add.reduceat(bits, starts)
    pixels = np.zeros(width * height, np.int64)
    at = done = level = 0
    while done < len(pixels):
        empty, full = (int(number) for number in numbers[at : at + 2])
        steps = numbers[at + 2 : at + 2 + full]
        levels = level + np.cumsum(steps >> 1 ^ -(steps & 1))
        pixels[done + empty : done + empty + full] = levels
        level = int(levels[-1]) if full else level
        at, done = at + 2 + full, done + empty + full
    return pixels.astype(np.uint16).reshape(height, width)
