"""Build an HTML page of a frame's depth maps as shaded surfaces that turn."""

from __future__ import annotations

import base64
import html
import json
from importlib.resources import files

import numpy as np

from glsim.core.depth_frame import DepthFrame


def surface_page(frame: DepthFrame) -> str:
    """Return an HTML page (WebGL 2, no network) of the clean and the noisy depth of a frame."""
    camera, shown = frame.intrinsics, []
    for layer in ("clean_mm", "noisy_mm"):
        if layer in frame:
            depth = np.nan_to_num(np.asarray(frame[layer], "<f4"))
            data = base64.b64encode(np.ascontiguousarray(depth).tobytes()).decode()
            shown.append([layer.removesuffix("_mm"), depth.shape[1], depth.shape[0], data])
    text = files("glsim.data").joinpath("surface.html").read_text(encoding="utf-8")
    numbers = json.dumps([camera.fx, camera.fy, camera.cx, camera.cy])
    values = {"title": html.escape(str(frame.name)), "maps": json.dumps(shown), "camera": numbers}
    for name, value in values.items():
        text = text.replace(f"{{{{{name}}}}}", value)
    return text
