"""PNG files: a fast encoder for depth maps, the decoder, depth files, and 8-bit pictures.

The encoder compresses with ISA-L's deflate. OpenCV takes 2.1 ms for a 512 x 424 frame with a face,
nearly all of it in zlib; ISA-L takes 0.2 ms. Each row is stored as its difference from the row
above, which makes files 0.61 to 1.01 times as large. OpenCV decodes; it is imported when it is
first needed.
Width and height are read from the file's own header first: 2 MB of deflate can hold 2 GB of zeros.

A map may state its step, its sensor and its layer in text chunks before the pixels.

PNG: W3C Recommendation, third edition. TIFF: Adobe, revision 6.0.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from isal import isal_zlib
from numpy.typing import NDArray

from glsim.core.errors import DatasetError
from glsim.core.files.atomic import write_atomic
from glsim.core.files.regular import open_regular, read_pixels

#: Largest width and height of an image, pixels: the largest camera that a sensor file may describe.
#: An image of this size takes 134 MB in 16 bits.
MAX_SIDE_PX = 8192
#: Largest image file, bytes: 16 bits of every pixel, uncompressed, and 1 MiB for its header.
MAX_IMAGE_BYTES = 2 * MAX_SIDE_PX**2 + (1 << 20)
#: Largest depth map of another program, pixels (2048 x 2048): time-of-flight cameras have up to 1
#: million. Measured: the shipped network takes 1 kB a pixel, a chain of stages half as much.
MAX_MAP_PX = 1 << 22

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_ANIMATION = (b"acTL", b"fcTL", b"fdAT")
_GREY, _RGB = 0, 2
_UP_FILTER, _LAST_FILTER = 2, 4
_PALETTE = 3
#: Colour type -> number of samples of a pixel, and possible numbers of bits of a sample.
_SAMPLES = {
    _GREY: (1, (1, 2, 4, 8, 16)), _RGB: (3, (8, 16)), _PALETTE: (1, (1, 2, 4, 8)),
    4: (2, (8, 16)), 6: (4, (8, 16)),
}  # fmt: skip
#: Keywords of the text chunks with the step of a depth map, mm, its simulated sensor, its layer.
UNIT_KEYWORD, SENSOR_KEYWORD, LAYER_KEYWORD = (
    b"glsim depth_unit_mm", b"glsim sensor", b"glsim layer",
)  # fmt: skip
#: Number of bytes to read of a file's beginning: the signature, IHDR and the chunks need fewer,
#: and longest name of a sensor.
_HEAD_BYTES, _LONGEST_NAME = 256, 64
#: Smallest and largest step of a depth file, mm: the range of --depth-unit-mm.
UNIT_RANGE_MM = (0.01, 10.0)
#: ISA-L's level. Levels 1 and 2 save a sixth of the bytes. But level 2 (ISA-L 2.32) hashes bytes by
#: a register that holds an address: for 1 of 4,000 files the same pixels become other bytes.
_ISAL_LEVEL = 0


def encode_png(
    image: NDArray[np.uint16] | NDArray[np.uint8],
    depth_unit_mm: float | None = None,
    sensor: str = "",
    layer: str = "",
) -> bytes:
    """Encode (H, W) uint16 or uint8 as a grey PNG file, (H, W, 3) as an RGB one.

    The same image gives the same bytes. A map may state its step, its sensor and its layer.
    """
    height, width = image.shape[:2]
    samples = np.ascontiguousarray(image, image.dtype.newbyteorder(">")).view(np.uint8)
    samples = samples.reshape(height, -1)
    colour = _GREY if image.ndim == 2 else _RGB
    rows = np.empty((height, 1 + samples.shape[1]), np.uint8)
    rows[:, 0] = _UP_FILTER
    rows[:, 1:] = samples
    rows[1:, 1:] -= samples[:-1]
    header = struct.pack(">IIBBBBB", width, height, image.dtype.itemsize * 8, colour, 0, 0, 0)
    stream = isal_zlib.compress(rows, _ISAL_LEVEL)
    chunks = [_chunk(b"IHDR", header), _chunk(b"IDAT", stream), _chunk(b"IEND", b"")]
    name = sensor[:_LONGEST_NAME].encode("latin-1", "replace")
    unit = b"" if depth_unit_mm is None else f"{depth_unit_mm:g}".encode()
    texts = ((UNIT_KEYWORD, unit), (SENSOR_KEYWORD, name), (LAYER_KEYWORD, layer.encode()))
    chunks[1:1] = [_chunk(b"tEXt", key + b"\0" + text) for key, text in texts if text]
    return b"".join([_SIGNATURE, *chunks])


def stated_unit_mm(path: Path, *, inside: Path | None = None) -> float | None:
    """Return the step, mm, that a depth PNG of glsim states; None for a file that states no step.

    Raises DatasetError if the statement is no valid step, or for a link out of ``inside``.
    """
    text = _stated_texts(path, inside).get(UNIT_KEYWORD)
    if text is None:
        return None
    try:
        unit_mm = float(text)
    except ValueError:
        unit_mm = float("nan")
    if not UNIT_RANGE_MM[0] <= unit_mm <= UNIT_RANGE_MM[1]:
        keyword = UNIT_KEYWORD.decode()
        raise DatasetError(f"{path}: its text {keyword} is no step from 0.01 to 10 mm")
    return unit_mm


def stated_text(path: Path, keyword: bytes) -> str:
    """Return the sensor or the layer that a PNG of glsim states; "" if it states none."""
    return _stated_texts(path).get(keyword, b"").decode("latin-1")


def _stated_texts(path: Path, inside: Path | None = None) -> dict[bytes, bytes]:
    """Return the texts between the header and the pixels of a PNG: keyword -> text."""
    try:
        with open_regular(path, inside=inside) as file:
            head = file.read(_HEAD_BYTES)
    except OSError:  # reported when the map is read
        return {}
    at, texts = 8 + 12 + 13, {}  # position behind the signature and IHDR
    while head[:8] == _SIGNATURE and head[at + 4 : at + 8] == b"tEXt":
        (length,) = struct.unpack(">I", head[at : at + 4])
        keyword, _, text = head[at + 8 : at + 8 + length].partition(b"\0")
        texts[keyword] = text
        at += 12 + length
    return texts


def _chunk(kind: bytes, data: bytes) -> bytes:
    checksum = isal_zlib.crc32(data, isal_zlib.crc32(kind))
    return b"".join([struct.pack(">I", len(data)), kind, data, struct.pack(">I", checksum)])


def image_size(data: bytes) -> tuple[int, int] | None:
    """Return (width, height), pixels, from the header of a PNG or TIFF file; None for others."""
    if data[:8] == _SIGNATURE and data[12:16] == b"IHDR" and len(data) >= 26:
        width, height = struct.unpack(">II", data[16:24])
        return width, height
    tags = _tiff_tags(data)
    return (tags[256][0], tags[257][0]) if {256, 257} <= tags.keys() else None


def _tiff_tags(data: bytes) -> dict[int, tuple[int, int]]:
    """Return tag -> (value, its position) of the first image of a TIFF or BigTIFF; {} for others.

    Tag 0 holds the position of the next image; 0 if there is none.
    """
    order, version = ("<" if data[:2] == b"II" else ">"), data[2:4].strip(b"\0")
    if data[:2] not in (b"II", b"MM") or version not in (b"*", b"+"):
        return {}
    start, entries, size, word, at = (
        (8, "Q", 20, "Q", 12) if version == b"+" else (4, "H", 12, "I", 8)
    )
    tags = {}
    try:
        (first,) = struct.unpack_from(order + word, data, start)
        (count,) = struct.unpack_from(order + entries, data, first)
        first += struct.calcsize(order + entries)
        for entry in range(first, first + size * min(count, 1000), size):
            tag, kind = struct.unpack_from(f"{order}HH", data, entry)
            if form := {3: "H", 4: "I", 16: "Q"}.get(kind):
                tags[tag] = *struct.unpack_from(order + form, data, entry + at), entry + at
        tags[0] = *struct.unpack_from(order + word, data, first + size * count), 0
    except struct.error:
        return {}
    return tags


def size_problem(data: bytes, max_px: int = MAX_SIDE_PX**2) -> str | None:
    """Return why an image file is refused: its size or form; None if it is accepted."""
    if _tiff_tags(data).get(0, (0, 0))[0]:
        return "holds several images: give each a file of its own, or all as one .npy stack"
    if data[:8] == _SIGNATURE and data[28:29] == b"\1":
        return "is an interlaced PNG file: save it without"
    size = image_size(data)
    if size is None or (max(size) <= MAX_SIDE_PX and size[0] * size[1] <= max_px):
        return None
    side = min(MAX_SIDE_PX, int(max_px**0.5))
    return f"is {size[0]} x {size[1]} pixels, more than the {side} x {side} that glsim reads"


def decode_png(data: bytes, max_px: int = MAX_SIDE_PX**2) -> NDArray[np.generic] | None:
    """Decode a PNG or TIFF file: (H, W) or (H, W, channels) in the file's own type.

    None for a damaged file, for another kind of file, and for an image above ``max_px`` pixels or
    MAX_SIDE_PX (``size_problem`` gives the reason), which is not decoded.
    """
    import cv2

    if image_size(data) is None or size_problem(data, max_px):
        return None
    if data[:8] == _SIGNATURE and (data := _checked_png(data)) == b"":
        return None
    cv2.utils.logging.setLogLevel(0)  # glsim reports failures itself
    tags = _tiff_tags(data)
    half = [tags.get(tag, (0, 0))[0] for tag in (258, 339)] == [16, 3]
    if half:  # OpenCV refuses 16-bit floats (BitsPerSample, SampleFormat), not integers
        one = struct.pack("<H" if data[:2] == b"II" else ">H", 1)
        data = data[: tags[339][1]] + one + data[tags[339][1] + 2 :]
    try:
        image: NDArray[np.generic] | None = cv2.imdecode(
            np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED
        )
    except cv2.error:
        return None
    return image.view(np.float16) if half and image is not None else image


def _checked_png(data: bytes) -> bytes:
    """Return an undamaged PNG file with its image alone, unpacked; b"" for all others."""
    # OpenCV allocates the length that a chunk states, up to 2 GB, before it reads the chunk. It
    # does not heed the checksum of the unpacked image, and its library prints messages about
    # damage and about chunks besides the image.
    chunks = _whole_chunks(data)
    palette, packed = chunks.get(b"PLTE", b""), chunks.get(b"IDAT", b"")
    if not packed:
        return b""
    width, height, bits, colour, *ways = struct.unpack(">IIBBBBB", data[16:29])
    samples, possible = _SAMPLES.get(colour, (1, ()))
    if bits not in possible or any(ways) or len(palette) % 3 or not width * height:
        return b""
    row = 1 + (width * samples * bits + 7) // 8
    unpack = isal_zlib.decompressobj()
    try:
        image = unpack.decompress(packed, row * height + 1)
    except Exception:  # isal's stubs do not know its error as one
        return b""
    whole = len(image) == row * height and unpack.eof and not unpack.unused_data
    if not whole or max(image[::row]) > _LAST_FILTER:
        return b""
    stream = zlib.compress(image, 0)  # stored, so that OpenCV need not unpack it again
    colours = [_chunk(b"PLTE", palette)] if colour == _PALETTE else []
    parts = [_chunk(b"IHDR", data[16:29]), *colours, _chunk(b"IDAT", stream), _chunk(b"IEND", b"")]
    return b"".join([_SIGNATURE, *parts])


def _whole_chunks(data: bytes) -> dict[bytes, bytes]:
    """Return the chunks of a PNG file, those of one name joined; {} if one is damaged or missing.

    It is also {} for an animation.
    """
    at, view, found = len(_SIGNATURE), memoryview(data), dict[bytes, list[memoryview]]()
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 8 + length
        if kind in _ANIMATION or isal_zlib.crc32(view[at + 4 : end]).to_bytes(4) != view[end:][:4]:
            return {}
        if kind == b"IEND":
            return {name: b"".join(parts) for name, parts in found.items()}
        found.setdefault(kind, []).append(view[at + 8 : end])
        at = end + 4
    return {}


def _pixels(data: Any) -> int:
    width, height = image_size(data) or (0, 0)
    return min(width * height, MAX_MAP_PX)


def is_image(path: Path) -> bool:
    """Return whether a file begins as a PNG or TIFF file does, whatever its suffix."""
    try:
        with open_regular(path) as file:
            return file.read(4) in (_SIGNATURE[:4], b"II*\0", b"MM\0*", b"II+\0", b"MM\0+")
    except OSError:
        return False


def read_image(path: Path, *, inside: Path | None = None) -> NDArray[Any]:
    """Read a PNG or TIFF file of at most MAX_MAP_PX pixels, see ``decode_png``.

    Grey PNG files that state fewer significant bits (sBIT) are shifted down to them. Raises
    DatasetError, also for a link that leads out of the folder ``inside``.
    """
    data = read_pixels(path, _pixels, inside=inside)
    image = decode_png(data, MAX_MAP_PX)
    if image is None:
        raise DatasetError(f"{path}: {size_problem(data, MAX_MAP_PX) or 'is no readable image'}")
    at = data.find(b"sBIT", 0, _HEAD_BYTES) if data[:8] == _SIGNATURE else -1
    if at > 0 and image.dtype == np.uint16 and 0 < data[at + 4] < 16:
        image = image.view(np.uint16) >> (16 - data[at + 4])
    return image


def write_picture(picture: NDArray[np.uint8], path: Path) -> None:
    """Write an (H, W, 3) uint8 BGR picture as a PNG file, atomically. Raises DatasetError."""
    import cv2

    write_atomic(cv2.imencode(".png", picture)[1].tobytes(), path)
