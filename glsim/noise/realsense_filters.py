"""The depth filters that librealsense offers for its cameras, as noise stages on arrays.

The rules are librealsense's, for disparities as floating-point numbers (src/proc/*.h and *.cpp,
read as facts; the code is our own). Its recommended order is spatial_filter, temporal_filter,
hole_filling. Its decimation makes a smaller image, which no stage can do: ``decimate`` is for maps.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Floats, Whole
from glsim.core.errors import ConfigError
from glsim.core.reason import Reason
from glsim.noise.frame_context import FrameContext, Layers
from glsim.noise.layer_names import EARLIER_LAYER
from glsim.noise.stage import array_stage

__all__ = ["hole_filling", "spatial_filter", "temporal_filter", "threshold_filter"]

Image = Floats
_Depth = TypeVar("_Depth", bound=np.number)
#: Disparities count 1/32 px: librealsense's disparity-transform.h has 5 bits behind the point.
_STEPS_PER_PX = 32.0
#: Mode of spatial_filter -> length that a row of holes must stay below to be filled, px
#: (librealsense's spatial-filter.cpp; its "unlimited" is 255).
_FILLED_BELOW_PX = (0, 2, 4, 8, 16, 255)
#: Persistence of temporal_filter -> (n, m): a hole takes the last depth if n of the m frames before
#: had one (librealsense's temporal-filter.cpp); 9 of 8: never.
_PERSISTENCE = ((9, 8), (8, 8), (2, 3), (2, 4), (2, 8), (1, 2), (1, 5), (1, 8), (0, 8))
#: Difference from the clean depth, as a share of it, beyond which a filled pixel carries the depth
#: of another surface. Chosen: 0.6 px at 1 m of a D435, as the filters' own delta.
_OTHER_SURFACE_SHARE = 0.03
#: A pixel's share in a filtered pixel is 0 for float32 below this. Derived: half of its last digit.
_NO_SHARE = 2.0**-24
#: Reach of a filter without a limit, px. Chosen: larger than any frame, so that all of it is drawn.
_WHOLE_FRAME_PX = 65536


def _spatial_reach_px(p: Mapping[str, float]) -> int:
    """Return the largest distance, pixels, over which ``spatial_filter`` spreads a value."""
    kept = 1.0 - p["alpha"]
    passed_px = 0 if kept <= 0 else int(np.ceil(np.log(_NO_SHARE) / np.log(kept)))
    return int(p["iterations"]) * passed_px + _FILLED_BELOW_PX[int(p["filling_mode"])]


@array_stage(
    _spatial_reach_px,
    (),
    alpha=("float", 0.5, 0.25, 1, "1", "weight of a pixel against its filtered neighbour"),
    delta=("float", 20, 1, 50, "px/32", "difference from which neighbours are two surfaces"),
    iterations=("int", 2, 1, 5, "1", "how often rows and columns are filtered"),
    filling_mode=("int", 0, 0, 5, "1", "0: none; else less than 2, 4, 8, 16, 255 px along a row"),
    unit_mm=("float", 1, 0, 100, "mm", "step of the depth that is delivered; 0: none"),
)  # fmt: skip
def spatial_filter(view: FrameContext, layers: Layers, p: Mapping[str, float]) -> dict[str, Image]:
    """Smooths the disparity along rows and columns, but not across edges."""

    def filtered(depth_m: Image) -> Image:
        steps = _steps(depth_m, view.focal_baseline_px_m)
        smooth = smooth_disparity(steps, p["alpha"], p["delta"], int(p["iterations"]))
        # Rightwards, then leftwards. The first column stays as it is, as in librealsense; its hole
        # in the last column takes the first pixel of the next row, an error that is not done here.
        below_px = _FILLED_BELOW_PX[int(p["filling_mode"])]
        rightwards = _carried(smooth, below_px)
        smooth[..., 1:] = _carried(rightwards[..., ::-1], below_px)[..., -2::-1]
        return _depth_m(smooth, steps, depth_m, view.focal_baseline_px_m, p["unit_mm"])

    written = _with_reasons(layers, filtered(layers["depth"]))
    if EARLIER_LAYER in layers:
        earlier = np.moveaxis(layers[EARLIER_LAYER], -1, 0)
        written[EARLIER_LAYER] = np.moveaxis(filtered(earlier), 0, -1)
    return written


@array_stage(
    lambda _: 0,
    (EARLIER_LAYER,),
    alpha=("float", 0.4, 0, 1, "1", "weight of this frame against the frames before"),
    delta=("float", 20, 1, 100, "px/32", "difference from which a pixel starts anew"),
    persistence=("int", 3, 0, 8, "1", "a hole takes the last depth if n of m before had one: "
        "0 never; 1 8/8; 2 2/3; 3 2/4; 4 2/8; 5 1/2; 6 1/5; 7 1/8; 8 always"),
    unit_mm=("float", 1, 0, 100, "mm", "step of the depth that is delivered; 0: none"),
)  # fmt: skip
def temporal_filter(view: FrameContext, layers: Layers, p: Mapping[str, float]) -> dict[str, Image]:
    """Averages each pixel's disparity over this frame and earlier ones of the same still scene."""
    if EARLIER_LAYER not in layers:
        raise ConfigError(
            f"temporal_filter reads the layer {EARLIER_LAYER!r}, which no stage before it writes: "
            "match_stereo does; filter the depth of other cameras by filter_sequence"
        )
    stack = np.concatenate([np.moveaxis(layers[EARLIER_LAYER], -1, 0), layers["depth"][None]])
    smooth = filter_sequence(
        stack, view.focal_baseline_px_m, p["alpha"], p["delta"], int(p["persistence"]), p["unit_mm"]
    )
    return _with_reasons(layers, smooth[-1])


@array_stage(
    lambda _: _WHOLE_FRAME_PX,
    (),
    mode=("int", 1, 0, 2, "1", "0: left neighbour; 1: farthest, 2: nearest of five neighbours"),
)
def hole_filling(view: FrameContext, layers: Layers, p: Mapping[str, float]) -> dict[str, Image]:
    """Fills holes with a neighbour's depth, from left to right and from top to bottom."""
    return _with_reasons(layers, fill_holes(layers["depth"], int(p["mode"])))


@array_stage(
    lambda _: 0,
    (),
    near_mm=("float", 100, 0, 65535, "mm", "depths below are removed"),
    far_mm=("float", 4000, 0, 65535, "mm", "depths beyond are removed"),
)
def threshold_filter(
    view: FrameContext, layers: Layers, p: Mapping[str, float]
) -> dict[str, Image]:
    """Removes depths outside a range."""
    depth, reason = layers["depth"].copy(), layers["reason"].copy()
    near_m, far_m = (np.float32(0.001 * p[name]) for name in ("near_mm", "far_mm"))
    outside = (depth > 0) & ((depth < near_m) | (depth > far_m))
    depth[outside], reason[outside] = 0.0, float(Reason.OUT_OF_RANGE)
    return {"depth": depth, "reason": reason}


def smooth_disparity(disparity: Image, alpha: float, delta: float, iterations: int) -> Image:
    """Smooth (..., H, W) disparities by passes right, left, down and up, ``iterations`` times.

    In a pass, a pixel becomes alpha times itself plus 1 - alpha times its filtered neighbour, if
    both had a disparity before the pass that differed by less than ``delta``. Disparities are
    float32 in 1/32 px, as ``delta`` is; 0 = hole, which stays one.
    """
    result = disparity.copy()
    own, kept = np.float32(alpha), np.float32(1.0) - np.float32(alpha)
    for axis, way in iterations * ((-1, 1), (-1, -1), (-2, 1), (-2, -1)):
        line = np.moveaxis(result, axis, 0)[::way]
        values = np.ascontiguousarray(line)
        before, here = values[:-1], values[1:]
        alike = (before > 0) & (here > 0) & (np.abs(here - before) < np.float32(delta))
        share = np.where(alike, own * here, here)
        carried = np.where(alike, kept, np.float32(0.0))
        for n in range(1, len(values)):
            values[n] = share[n - 1] + carried[n - 1] * values[n - 1]
        line[:] = values
    return result


def _carried(image: Image, below_px: int) -> Image:
    """Fill each hole with the last value on its left, if that is less than ``below_px`` away."""
    column = np.arange(image.shape[-1])
    last = np.maximum.accumulate(np.where(image > 0, column, -1), axis=-1)
    fills = (image <= 0) & (last >= 0) & (column - last < below_px)
    taken: Image = np.take_along_axis(image, np.maximum(last, 0), axis=-1)
    return np.where(fills, taken, image)


def smooth_in_time(disparity: Image, alpha: float, delta: float, persistence: int) -> Image:
    """Average (T, H, W) disparities, float32 in 1/32 px, over time, each pixel for itself.

    A pixel becomes alpha times itself plus 1 - alpha times its last result, if the two differ by
    less than ``delta``, 1/32 px; otherwise it starts anew. A hole (0) takes the last result if
    enough of the eight frames before agreed, by the ``persistence`` of ``temporal_filter``.
    """
    needed, among = _PERSISTENCE[persistence]
    bits = np.arange(256, dtype=np.uint8)[:, None]
    believed = np.unpackbits(bits, axis=1, bitorder="little")[:, :among].sum(axis=1) >= needed
    own, kept = np.float32(alpha), np.float32(1.0) - np.float32(alpha)
    last = np.zeros_like(disparity[0])
    history = np.zeros(last.shape, np.uint8)  # bit 0: the frame before this one
    results = np.empty_like(disparity)
    for now, result in zip(disparity, results, strict=True):
        known = now > 0
        alike = known & (last > 0) & (np.abs(now - last) < np.float32(delta))
        result[:] = np.where(alike, own * now + kept * last, now)
        fills = ~known & (last > 0) & believed[history]
        result[fills] = last[fills]
        last = np.where(known, result, last)
        aged = history << np.uint8(1)
        history = np.where(alike, aged | np.uint8(1), np.where(known, np.uint8(1), aged))
    return results


def filter_sequence(
    depth_m: Image,
    focal_baseline_px_m: float,
    alpha: float = 0.4,
    delta: float = 20.0,
    persistence: int = 3,
    unit_mm: float = 1.0,
) -> Image:
    """Filter the depth of a recording by librealsense's temporal filter.

    Args:
        depth_m: (T, H, W) float32, metres, in order of time; 0 = hole.
        focal_baseline_px_m: focal length times baseline, pixels times metres.
        alpha, delta, persistence, unit_mm: as of ``temporal_filter``.
    """
    steps = _steps(depth_m, focal_baseline_px_m)
    smooth = smooth_in_time(steps, alpha, delta, persistence)
    return _depth_m(smooth, steps, depth_m, focal_baseline_px_m, unit_mm)


def fill_holes(depth: Image, mode: int) -> Image:
    """Fill holes from neighbours in reading order, so that depth spreads to the right and down.

    Modes 1 and 2 look at the pixels above, above left, left, below left and below, and leave the
    first and the last row and the first column. Mode 2 keeps a hole below a hole. Depth is (H, W)
    float32 in any unit, 0 = hole; modes: 0 left, 1 farthest, 2 nearest.
    """
    if mode == 0:
        return _carried(depth, depth.shape[-1])
    # The bits of floats above 0 are ordered as the floats are. Parts of a row begin with the pixels
    # that do not look to their left; a part's number stands above the 33 bits of its values.
    bits: Whole = np.ascontiguousarray(depth).view(np.int32).astype(np.int64)
    nothing, sign = (np.int64(0), 1) if mode == 1 else (np.int64(2**31), -1)
    for row in range(1, len(bits) - 1):
        above, here, below = bits[row - 1], bits[row], bits[row + 1]
        around = np.stack([above[1:], above[:-1], below[:-1], below[1:]])
        around = sign * np.where(around > 0, around, nothing)
        looks = here == 0
        looks[0] = False
        if mode == 2:
            looks &= above > 0
        value = sign * np.where(here > 0, here, nothing)
        value[1:] = np.where(looks[1:], around.max(axis=0), value[1:])
        part = np.cumsum(~looks) << 33
        chosen = sign * (np.maximum.accumulate(part + value) - part)
        bits[row] = np.where(chosen == nothing, 0, chosen)
    return bits.astype(np.int32).view(np.float32)


def decimate(depth: NDArray[_Depth], factor: int) -> NDArray[_Depth]:
    """Shrink (..., H, W) depth maps in any unit as librealsense's decimation by 2 or 3 does.

    To (..., H // factor, W // factor): the lower median of each block's pixels with depth, 0
    without. Blocks at the right and lower edge that are not whole are cut off.
    """
    height, width = (size // factor for size in depth.shape[-2:])
    cut = depth[..., : height * factor, : width * factor]
    blocks = cut.reshape(*depth.shape[:-2], height, factor, width, factor).swapaxes(-3, -2)
    ordered = np.sort(blocks.reshape(*depth.shape[:-2], height, width, factor**2))
    holes = (ordered == 0).sum(axis=-1, keepdims=True)  # they come first
    middle = np.minimum((holes + factor**2 - 1) // 2, factor**2 - 1)
    return np.take_along_axis(ordered, middle, axis=-1)[..., 0]


def _steps(depth_m: Image, focal_baseline_px_m: float) -> Image:
    """Convert depth, metres, to disparity in 1/32 px, or disparity to depth; 0 stays 0."""
    if focal_baseline_px_m <= 0:
        raise ConfigError(
            "spatial_filter and temporal_filter work on disparity, but the rig has no baseline: "
            "give it an emitter or a second imager beside the camera"
        )
    known = depth_m > 0
    constant = np.float32(_STEPS_PER_PX * focal_baseline_px_m)
    return np.divide(constant, depth_m, out=np.zeros_like(depth_m), where=known)


def _depth_m(
    steps: Image, steps_before: Image, before_m: Image, focal_baseline_px_m: float, unit_mm: float
) -> Image:
    """Convert disparities to depth in steps of ``unit_mm``; unchanged pixels keep their depth."""
    depth_m = _steps(steps, focal_baseline_px_m)  # the conversion is its own inverse
    if unit_mm > 0:
        unit_m = np.float32(0.001 * unit_mm)
        whole = np.maximum(np.floor(depth_m / unit_m + np.float32(0.5)), np.float32(1.0))
        depth_m = np.where(depth_m > 0, whole * unit_m, np.float32(0.0))
    return np.where(steps == steps_before, before_m, depth_m)


def _with_reasons(layers: Layers, depth_m: Image) -> dict[str, Image]:
    """Return the layers depth and reason, with new reason codes for the pixels that were filled."""
    clean, reason = layers["clean"], layers["reason"]
    filled = (depth_m > 0) & (layers["depth"] <= 0)
    other = np.abs(depth_m - clean) > _OTHER_SURFACE_SHARE * clean
    code = np.where(other, np.float32(Reason.MOVED), np.float32(Reason.VALID))
    code = np.where(clean > 0, code, np.float32(Reason.GROWN))
    return {"depth": depth_m, "reason": np.where(filled, code, reason)}
