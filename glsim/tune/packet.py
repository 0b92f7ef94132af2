"""Pack a picture for the browser: a JSON head, then the raw bytes of its layers.

    4 bytes   length of the head, little-endian, padded to a multiple of 4
    head      {"width", "height", "window": [left, top, w, h], "layers": [[name, type], ...], ...}
    layers    (h, w) of the window, uint16, uint8 or float32, little-endian, each padded to 4 bytes

The layers of the tuner are those that the sensor has: clean, noisy, reason and infrared of all,
infrared_right of stereo cameras, and disparity (pixels) of cameras that match images. Outside the
window every layer is 0 and the reason is NO_SURFACE. Those of ``glsim live`` are noisy (as
measured), clean (as denoised) and infrared.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.frame import LAYERS, Frame
from glsim.geometry.camera import Intrinsics
from glsim.noise.layer_names import DISPARITY_LAYER, INFRARED_RIGHT

_TYPES = {"uint8": "u1", "uint16": "u2", "float32": "f4"}


def pack(frame: Frame, **head: Any) -> bytes:
    """Return the packet of a frame; head: further JSON values."""
    layers = dict(shown_layers(frame))
    return pack_layers(
        frame.intrinsics, layers, frame.depth_unit_mm, window=list(frame.window), **head
    )


def pack_layers(
    camera: Intrinsics, layers: Mapping[str, NDArray[Any]], depth_unit_mm: float, **head: Any
) -> bytes:
    """Return the packet of layers.

    Args:
        camera: of the whole frame.
        layers: name -> (h, w) of the window, uint8, uint16 or float32.
        depth_unit_mm: step of the depths, mm.
        head: further JSON values; without ``window`` the layers are of the whole frame.
    """
    tree = {
        "width": camera.width,
        "height": camera.height,
        "window": [0, 0, camera.width, camera.height],
        "focal_px": [camera.fx, camera.fy],
        "centre_px": [camera.cx, camera.cy],
        "depth_unit_mm": depth_unit_mm,
        "layers": [[name, _TYPES[layer.dtype.name]] for name, layer in layers.items()],
        **head,
    }
    text = json.dumps(tree, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    parts = [len(text).to_bytes(4, "little"), text, *map(_padded, layers.values())]
    return b"".join(parts)


def image_names(frame: Frame) -> tuple[str, ...]:
    """Return the names of a frame's images: those of every frame, and the second infrared one."""
    stereo = frame.infrared_right_counts is not None
    return (*LAYERS, INFRARED_RIGHT) if stereo else LAYERS


def shown_layers(frame: Frame) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the names and (h, w) values of the layers that a frame has, within its window."""
    for name in image_names(frame):
        yield name, frame.image(name)[frame.window.slices]
    if DISPARITY_LAYER in frame.extra:
        yield DISPARITY_LAYER, frame.extra[DISPARITY_LAYER]


def _padded(image: NDArray[Any]) -> bytes:
    raw = np.ascontiguousarray(image, image.dtype.newbyteorder("<")).tobytes()
    return raw + b"\0" * (-len(raw) % 4)
