"""OpenEXR files of one channel, by the library OpenEXR of the extra ``formats``."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import require_package


def require_exr(what: str) -> None:
    """Raise ConfigError if the library that ``what`` needs is not installed."""
    require_package("OpenEXR", what, "formats")


def encode_exr(depth_m: NDArray[np.float32]) -> bytes:
    """Return an OpenEXR file with the (H, W) float32 channel Y; the same bytes each time.

    Y is luminance: programs read a file with this channel alone as one grey image.

    Raises ConfigError without the library.
    """
    require_exr("writing OpenEXR files")
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    data = io.BytesIO()
    rows = np.ascontiguousarray(depth_m, np.float32)
    with OpenEXR.File(header, {"Y": rows}) as file:
        file.write(data)
    return data.getvalue()


def decode_exr(data: bytes, max_px: int) -> dict[str, NDArray[Any]] | None:
    """Return the channels of an OpenEXR file by name; None for more than ``max_px`` pixels.

    Raises:
        ConfigError: without the library.
        ValueError: it is no readable file.
    """
    require_exr("reading OpenEXR files")
    import OpenEXR

    try:
        with OpenEXR.File(io.BytesIO(data), header_only=True) as header:
            low, high = header.header()["dataWindow"]
        if (high[0] - low[0] + 1) * (high[1] - low[1] + 1) > max_px:
            return None
        with OpenEXR.File(io.BytesIO(data), separate_channels=True) as file:
            return {name: channel.pixels for name, channel in file.channels().items()}
    except (OSError, RuntimeError, ValueError, KeyError, TypeError) as error:
        raise ValueError("is cut short, or no OpenEXR file") from error
