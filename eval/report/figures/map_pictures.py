"""Pictures of one depth map for figures: its depth, its signed error and its normals, as RGB."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.camera import Intrinsics
from glsim.core.depth_map import normals
from glsim.denoise.interface import Depth
from glsim.eval.report.figures.style import matplotlib

#: Range of the signed-error colours, mm, in every figure.
ERROR_RANGE_MM: Final = 10.0
#: Colours: no depth in either map; depth without a surface; a surface without depth.
NOTHING, FALSE_VALID, FALSE_INVALID = "#dcdcdc", "#ffc20a", "#1a1a1a"
#: Colour of flying pixels in side views.
FLYING: Final = "#dc1e1e"
#: Margin around the face, px.
_MARGIN_PX: Final = 6


def depth_colours(clean: Depth) -> Any:
    """Return the mapping from millimetres to colours that suits a frame."""
    low, high = depth_range(clean)
    normalize = matplotlib("colors").Normalize(low, high)
    return matplotlib("cm").ScalarMappable(normalize, "viridis_r")


def error_colours() -> Any:
    """Return the mapping from prediction - truth, mm, to colours."""
    normalize = matplotlib("colors").Normalize(-ERROR_RANGE_MM, ERROR_RANGE_MM)
    return matplotlib("cm").ScalarMappable(normalize, "RdBu_r")


def colour_legend() -> list[Any]:
    """Return the legend of the colours that are no values: handles for ``figure.legend``."""
    patch, lines = matplotlib("patches").Patch, matplotlib("lines").Line2D
    return [
        patch(facecolor=FALSE_VALID, label="depth where there is no surface"),
        patch(facecolor=FALSE_INVALID, label="surface without depth"),
        patch(facecolor=NOTHING, label="no depth in either"),
        lines([], [], marker="o", linestyle="", markersize=3, color=FLYING, label="flying pixel"),
    ]


def face_window(clean: Depth) -> tuple[slice, slice]:
    """Return rows and columns of the face with a margin; the whole image without a face."""
    rows, columns = (np.flatnonzero((clean > 0).any(axis=axis)) for axis in (1, 0))
    if rows.size == 0:
        return slice(0, clean.shape[0]), slice(0, clean.shape[1])
    return (
        slice(max(0, int(rows[0]) - _MARGIN_PX), int(rows[-1]) + 1 + _MARGIN_PX),
        slice(max(0, int(columns[0]) - _MARGIN_PX), int(columns[-1]) + 1 + _MARGIN_PX),
    )


def depth_range(clean: Depth) -> tuple[float, float]:
    """Return the range of the depth colours, mm: the truth's depths without the farthest 1 %."""
    depths = clean[clean > 0]
    if depths.size == 0:
        return 0.0, 1.0
    low, high = np.percentile(depths, [0, 99])
    return float(low), float(max(high, low + 1))


def nose_row(clean: Depth) -> int:
    """Return the row of the nearest point."""
    return int(np.argmin(np.where(clean > 0, clean, np.inf).min(axis=1)))


def _rgb(colour: str) -> NDArray[np.float64]:
    return np.array(matplotlib("colors").to_rgb(colour))


def depth_picture(depth: Depth, mapping: Any) -> NDArray[np.float64]:
    """Colour (H, W) depth, mm, by ``depth_colours``: (H, W, 3) in [0, 1]."""
    picture: NDArray[np.float64] = mapping.to_rgba(depth)[..., :3]
    picture[depth <= 0] = _rgb(NOTHING)
    return picture


def error_picture(prediction: Depth, clean: Depth, mapping: Any) -> NDArray[np.float64]:
    """Colour prediction - clean, mm, by ``error_colours``: (H, W, 3) in [0, 1]."""
    picture: NDArray[np.float64] = mapping.to_rgba(prediction - clean)[..., :3]
    valid, real = prediction > 0, clean > 0
    for pixels, colour in (
        (~valid & ~real, NOTHING),
        (valid & ~real, FALSE_VALID),
        (~valid & real, FALSE_INVALID),
    ):
        picture[pixels] = _rgb(colour)
    return picture


def normal_picture(depth: Depth, intrinsics: Intrinsics) -> NDArray[np.float64]:
    """Colour normals as usual: x is red, y (up) green, towards the camera blue."""
    normal = normals(depth / np.float32(1000), intrinsics.rays())
    picture: NDArray[np.float64] = 0.5 + 0.5 * normal.astype(np.float64) * (1, -1, -1)
    picture[depth <= 0] = _rgb(NOTHING)
    return picture
