"""Read and write OpenEXR files by the library OpenEXR of the extra ``formats``."""

from __future__ import annotations

import io
import os
import re
import struct
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout
from pathlib import Path
from threading import Lock
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Floats
from glsim.core.errors import require_package
from glsim.core.files.regular import MOST_HELD

#: Words in the names of channels that do not hold depth.
_OTHER: Final = re.compile(
    r"(^|\.)a$|\b(alpha|nn?|ns|normals?|pp?|position|motion|vector|velocity|uv|mist|conf|confidence|variance"
    r"|mask|valid|id|index|albedo|shadow|ao)\b|inv|dispar"
)
#: Patterns of depth channels in lower case, the surest first. Mitsuba: dd.T; Blender: *.Z and *.V.
_DEPTH: Final = (r"(.*\.)?depth(\..*)?|z", r".*depth.*", r".*\.[zt]", r"(.*\.)?v")
#: Largest headers of all parts, bytes. Chosen.
_HEADERS_BYTES: Final = 1 << 18
#: Held while stdout and stderr, which all threads share, are redirected.
_OUTPUT: Final = Lock()
#: Channels z and v are no depth if these channels exist: a vector x, y, z or a colour h, s, v, u.
_AXES: Final = {"z": "xy", "v": "uhs"}


def require_exr(what: str) -> None:
    """Raise ConfigError if the library that ``what`` needs is not installed."""
    require_package("OpenEXR", what, "formats")


def encode_exr(depth_m: Floats) -> bytes:
    """Return an OpenEXR file with the float32 channel Y (luminance); the same bytes each time."""
    require_exr("writing OpenEXR files")
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    data = io.BytesIO()
    with OpenEXR.File(header, {"Y": np.ascontiguousarray(depth_m, np.float32)}) as file:
        file.write(data)
    return data.getvalue()


@contextmanager
def _quiet() -> Iterator[None]:
    """Discard the output of the EXR library; it raises the errors that it prints."""
    with _OUTPUT, Path(os.devnull).open("w") as nothing, redirect_stdout(nothing):
        kept = os.dup(2)
        os.dup2(nothing.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)


def decode_exr(data: bytes, max_px: int) -> dict[str, NDArray[Any]] | None:
    """Return the channels of an OpenEXR file by name; None if it is too large.

    The limits are ``max_px`` pixels and MOST_HELD numbers in all channels, because the library
    reads all of them. In files of several parts a channel's name begins with its part's. Raises
    ConfigError without the library, ValueError for an unreadable file.
    """
    require_exr("reading OpenEXR files")
    import OpenEXR

    channels = {}
    try:
        with OpenEXR.File(io.BytesIO(data), header_only=True) as header:
            count, numbers = len(header.parts), 0
            for part in header.parts:
                (left, top), (right, bottom) = np.array(part.header["dataWindow"]).tolist()
                pixels = (right - left + 1) * (bottom - top + 1)
                numbers += pixels * len(part.header["channels"])
                if pixels > max_px or numbers > MOST_HELD:
                    return None
        with _quiet(), OpenEXR.File(io.BytesIO(data), separate_channels=True) as file:
            if not 0 < len(file.parts) == count:
                raise ValueError("a part is missing")
            for part in file.parts:
                front = f"{part.name()}." if count > 1 else ""
                for name, channel in part.channels.items():
                    pixels = _displayed(channel.pixels, part.header, max_px)
                    channels[front + name.removeprefix(front)] = pixels
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
        raise ValueError("is cut short, or no OpenEXR file") from error
    return channels


def exr_pixels(data: Any) -> int:
    """Return the number of pixels in all parts of an OpenEXR file, by its headers."""
    windows = re.findall(rb"dataWindow\0box2i\0.{4}(.{16})", data[:_HEADERS_BYTES], re.DOTALL)
    sizes = (struct.unpack("<4i", window) for window in windows)
    return sum(max(x - left + 1, 0) * max(y - top + 1, 0) for left, top, x, y in sizes)


def _displayed(pixels: NDArray[Any], header: dict[str, Any], max_px: int) -> NDArray[Any]:
    """Place the pixels of the data window in the display window, with 0 around. Raises ValueError.

    The frames of an animation share one display window; a data window holds the filled pixels.
    """
    (left, top), _ = np.array(header["dataWindow"]).tolist()
    (x, y), (right, bottom) = np.array(header["displayWindow"]).tolist()
    shape, (height, width) = (bottom - y + 1, right - x + 1), pixels.shape[:2]
    inside = x <= left and left + width <= right + 1 and y <= top and top + height <= bottom + 1
    if not inside or (height, width) == shape:
        return pixels
    if shape[0] * shape[1] > max_px:
        raise ValueError("its display window is too large")
    placed = np.zeros(shape + pixels.shape[2:], pixels.dtype)
    placed[top - y : top - y + height, left - x : left - x + width] = pixels
    return placed


def depth_channel(channels: dict[str, NDArray[Any]], chosen: str | None = None) -> NDArray[Any]:
    """Return the depth channel: the chosen one, one with a name of depth, or the only one.

    Raises ValueError, with the channels' names, for no such channel, and for several that differ.
    """
    name = depth_name(channels, chosen)
    return next(pixels for key, pixels in channels.items() if key.lower() == name)


def depth_name(channels: dict[str, NDArray[Any]], chosen: str | None = None) -> str:
    """Return the name of ``depth_channel`` in lower case. Raises the same ValueError."""
    of_name = {name.lower(): pixels for name, pixels in channels.items()}
    names = [name for name in of_name if not _OTHER.search(name)]
    for last, axes in _AXES.items():
        names = [n for n in names if n[-1:] != last or not any(n[:-1] + o in of_name for o in axes)]
    tiers = [[name for name in names if re.fullmatch(pattern, name)] for pattern in _DEPTH]
    alone = names if len(of_name) == 1 and names and names[0] not in ("g", "b", "x", "u") else []
    found = [chosen.lower()] if chosen else next(filter(None, tiers), alone)
    images = [of_name[name] for name in found if name in of_name]
    if not images or not all(np.array_equal(images[0], other, True) for other in images[1:]):
        lacks = f"no channel {chosen}" if chosen else "no channel that is surely depth"
        raise ValueError(
            f"has {lacks}: choose one of {', '.join(channels)} with --channel (denoise, corrupt), "
            "or with channel = NAME in a camera.toml beside a recording"
        )
    return next(name for name in found if name in of_name)
