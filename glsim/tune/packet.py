"""Pack a picture for the browser: a JSON head, then the raw bytes of its layers.

    4 bytes   length of the head, little-endian, padded to a multiple of 4
    head      {"width", "height", "window": [left, top, w, h], "layers": [[name, type], ...], ...}
    layers    (h, w) of the window, uint16 or uint8, little-endian, each padded to 4 bytes

Outside the window every layer is 0 and the reason is NO_SURFACE.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.frame import Frame

#: The layers of a packet, in order.
LAYERS = (("clean", "u2"), ("noisy", "u2"), ("infrared", "u2"), ("reason", "u1"))


def pack(frame: Frame, **head: Any) -> bytes:
    """Return the packet of a frame; head: further JSON values."""
    camera = frame.intrinsics
    tree = {
        "width": camera.width,
        "height": camera.height,
        "window": list(frame.window),
        "focal_px": [camera.fx, camera.fy],
        "centre_px": [camera.cx, camera.cy],
        "depth_unit_mm": frame.depth_unit_mm,
        "layers": [list(layer) for layer in LAYERS],
        **head,
    }
    text = json.dumps(tree, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    parts = [len(text).to_bytes(4, "little"), text]
    for name, kind in LAYERS:
        parts.append(_padded(frame.image(name)[frame.window.slices].astype(f"<{kind}")))
    return b"".join(parts)


def _padded(image: NDArray[Any]) -> bytes:
    raw = np.ascontiguousarray(image).tobytes()
    return raw + b"\0" * (-len(raw) % 4)
