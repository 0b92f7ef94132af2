"""The origin of depth values: the camera, or the nearest point of the frame.

    depth   as measured: millimetres from the camera
    paper   each frame is moved along the optical axis until the nearest point of its true depth is
            at 1 mm, as Kendrick, Yap and Tan position their faces

Data sets record the millimetres that were subtracted from a frame (``depth_offset_mm``), so that
either protocol can be read from any data set. Training, scoring and denoising use the depths of one
protocol. In both, 0 means no depth.
"""

from __future__ import annotations

from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError, did_you_mean

DepthProtocol = Literal["depth", "paper"]
#: Depth of the nearest point under ``paper``, mm. Source: the paper's section on training.
NEAREST_MM: Final = 1.0
#: Protocol -> its meaning, one line for reports.
MEANING: Final[dict[DepthProtocol, str]] = {
    "depth": "depth as measured from the camera",
    "paper": f"the nearest point of each frame at {NEAREST_MM:g} mm",
}


def check_protocol(text: str | None, option: str = "--protocol") -> DepthProtocol | None:
    """Return the protocol with this name; None for None. Raises ConfigError for another name."""
    if text is None:
        return None
    for name in get_args(DepthProtocol):
        if text == name:
            return name  # type: ignore[no-any-return]
    raise ConfigError(f"{option} {text}: {did_you_mean(text, get_args(DepthProtocol))}")


def stored_protocol(nearest_to_mm: float | None) -> DepthProtocol:
    """Return the protocol of the depths of a data set from its setting ``nearest_to_mm``."""
    return "paper" if nearest_to_mm == NEAREST_MM else "depth"


def offset_to_nearest(depth_mm: NDArray[np.floating], nearest_mm: float = NEAREST_MM) -> float:
    """Compute mm to subtract so that the nearest depth is ``nearest_mm``; 0 without any depth."""
    valid = depth_mm[depth_mm > 0]
    return float(valid.min()) - nearest_mm if valid.size else 0.0
