"""Twins of shaders/lib: layers, depth, disparity, random, kernel and correlated_noise.glsl.

Random numbers are functions of (pixel, seed, draw), equal to the shaders' numbers bit for bit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import reduce
from typing import Any

from glsim.core.array_types import Mask, Reals
from glsim.core.arrays import Numbers, Words, of
from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.frame_context import FrameContext

#: Float32 pixels: (h, w) or (h, w, components) of NumPy, (B, h, w) or (B, h, w, components) of
#: PyTorch. The types are NumPy's for both libraries.
Image = Reals
#: Layers by name. Parameters, too, by their GLSL names: numbers, or (B, 1, 1) one for each map.
Layers = Mapping[str, Image]
Parameters = Mapping[str, float]
#: A function (dx, dy) -> each pixel's neighbour at that offset: see ``around``.
Neighbours = Callable[[int, int], Image]

#: Smallest depth of a moved pixel, m, because 0 means no depth.
_LEAST_M = 1e-4

#: libfreenect2's 3x3 Gaussian: |dx| + |dy| of a neighbour -> weight.
KERNEL = {0: 0.1195716, 1: 0.1131098, 2: 0.1069973}
KERNEL_UNIT = 2.99791


def pixels(window: Rect, like: Any = 0) -> tuple[Words, Words]:
    """Return a window's columns (1, w) and rows (h, 1) in the frame, on the device of ``like``."""
    left, top, width, height = window
    xp = of(like)
    return (xp.range(left, left + width, like)[None, :], xp.range(top, top + height, like)[:, None])


def fetch(layer: Image, window: Rect, x: Words, y: Words) -> Image:
    """Read a window's layer at columns x and rows y of the frame, which broadcast; 0 outside."""
    xp = of(layer)
    column, row = x - window.left, y - window.top
    # Columns and rows are compared before they broadcast: h + w comparisons instead of h w.
    inside = ((column >= 0) & (column < window.width)) & ((row >= 0) & (row < window.height))
    column, row = xp.clip(column, 0, window.width - 1), xp.clip(row, 0, window.height - 1)
    if layer.ndim == 2:
        return xp.where(inside, layer[row, column], 0.0)
    place: Any = xp.integers(row * window.width + column)
    tensor: Any = layer
    at = place.expand(len(layer), -1, -1)
    there = tensor.flatten(1).gather(1, at.flatten(1)).reshape(at.shape)
    return xp.where(inside, there, 0.0)


def padded(view: FrameContext, layer: Image, reach: int, *, clamped: bool = False) -> Image:
    """Pad a layer by ``reach`` pixels on each side.

    Inside the frame but outside the window the padding is 0. Outside the frame it is 0 too, or, if
    ``clamped``, the nearest pixel of the frame.
    """
    left, top, width, height = view.window
    if view.batched:  # the window of a batch is the whole frame
        tensor: Any = layer
        planes = tensor.movedim(3, 0) if layer.ndim == 4 else tensor[None]
        mode = "replicate" if clamped else "constant"
        planes = of(layer).nn.functional.pad(planes, (reach,) * 4, mode=mode)
        wider: Image = planes.movedim(0, 3) if layer.ndim == 4 else planes[0]
        return wider
    xp = of(layer)
    x, y = (
        xp.arange(start - reach, start + side + reach)
        for start, side in ((left, width), (top, height))
    )
    if clamped:
        x, y = xp.clip(x, 0, view.width - 1), xp.clip(y, 0, view.height - 1)
    x, y = x - left, y - top
    wide = layer[xp.clip(y, 0, height - 1)][:, xp.clip(x, 0, width - 1)]
    wide[(y < 0) | (y >= height)] = 0.0
    wide[:, (x < 0) | (x >= width)] = 0.0
    return wide


def around(
    view: FrameContext, layer: Image, reach: int, *, clamped: bool = False, at: Any = None
) -> Neighbours:
    """Return a function (dx, dy) -> the layer's values at that offset from each pixel.

    Its results may share memory: do not write to them. ``at`` is the map, row and column of some
    pixels of a batch; by default all pixels of the window. Other arguments are as in ``padded``.
    """
    wide, (_, _, width, height) = padded(view, layer, reach, clamped=clamped), view.window
    if at is None:
        maps = (slice(None),) * view.batched

        def neighbour(dx: int, dy: int) -> Image:
            row, column = reach + dy, reach + dx
            return wide[(*maps, slice(row, row + height), slice(column, column + width))]

        return neighbour
    width += 2 * reach
    first = (at[0] * wide.shape[1] + at[1] + reach) * width + at[2] + reach
    tensor: Any = wide
    flat = tensor.movedim(3, 0).flatten(1) if wide.ndim == 4 else tensor.flatten()
    return lambda dx, dy: flat.index_select(-1, first + (dy * width + dx)).movedim(0, -1)


def value_range(view: FrameContext, layer: Image, reach: int) -> Image:
    """Compute the largest minus the smallest value within ``reach`` px, clamped at the border."""
    xp, there = of(layer), around(view, layer, reach, clamped=True)
    parts = [there(*to) for to in square(reach)]
    return reduce(xp.maximum, parts) - reduce(xp.minimum, parts)


def where_worthwhile(view: FrameContext, needed: Any, p: Parameters) -> tuple[Any, Parameters]:
    """Return the pixels of a mask (map, row, column), and the parameters of each pixel.

    This saves work for a batch on a CPU. NumPy and GPUs get None and the unchanged parameters, and
    compute all pixels; a GPU would stall to count the masked pixels.
    """
    if not view.batched or needed.device.type != "cpu":
        return None, p
    at = needed.nonzero(as_tuple=True)
    return at, {n: v if isinstance(v, float) else v.flatten()[at[0]] for n, v in p.items()}


def square(reach: int) -> Iterator[tuple[int, int]]:
    """Yield the offsets (dx, dy) of a square of half side ``reach``, in reading order."""
    side = range(-reach, reach + 1)
    return ((dx, dy) for dy in side for dx in side)


def mix(a: Image, b: Image, t: Image) -> Image:
    """Interpolate linearly from ``a`` at t = 0 to ``b`` at t = 1."""
    return a + t * (b - a)


def select(choices: Sequence[tuple[Mask, Numbers]], other: Image) -> Image:
    """Return for each pixel the number of the first condition that holds, else ``other``."""
    for condition, number in reversed(choices):
        other = of(condition).where(condition, number, other)
    return other


def has_depth(reason: Image) -> Mask:
    """Mark the pixels whose reason code means that they have depth."""
    codes = [float(r) for r in Reason if r.has_depth]
    mask: Mask = reason == codes[0]
    for code in codes[1:]:
        mask = mask | (reason == code)
    return mask


def reasons_of_taken(layers: Layers, depth_m: Image, lost: Reason) -> Image:
    """Return the reason codes for new depths, m; pixels that lose their depth get ``lost``."""
    xp, here = of(depth_m), layers["depth"]
    new = xp.where(layers["clean"] > 0, float(Reason.MOVED), float(Reason.GROWN))
    reason = xp.where((depth_m <= 0) & (here > 0), float(lost), layers["reason"])
    return xp.where((depth_m > 0) & (here <= 0), new, reason)


def moved_by_mm(depth_m: Image, by_mm: Image) -> Image:
    """Add millimetres to depth (metres); 0, no depth, stays 0."""
    xp = of(depth_m)
    return xp.where(depth_m > 0, xp.maximum(depth_m + 0.001 * by_mm, _LEAST_M), 0.0)


def disparity_px(depth_m: Image, focal_baseline_px_m: float) -> Image:
    """Convert depth, m, to disparity, px, or disparity to depth; undefined where depth is 0."""
    return focal_baseline_px_m / of(depth_m).where(depth_m > 0, depth_m, 1.0)


def displaced(view: FrameContext, layers: Layers, by_mm: Image, by_px: Image) -> dict[str, Image]:
    """Return the layer depth, moved first by disparity, px, then by millimetres."""
    depth, fb = layers["depth"], view.focal_baseline_px_m
    xp = of(depth)
    moved = fb / xp.maximum(disparity_px(depth, fb) + by_px, 1e-3)
    return {"depth": moved_by_mm(xp.where((depth > 0) & (by_px != 0), moved, depth), by_mm)}


def without(layers: Layers, lost: Mask, reason: Reason | Image) -> dict[str, Image]:
    """Return the layers depth and reason after removing the depth of the pixels ``lost``."""
    depth = layers["depth"]
    xp, lost = of(depth), lost & (depth > 0)
    return {
        "depth": xp.where(lost, 0.0, depth),
        "reason": xp.where(
            lost, float(reason) if isinstance(reason, int) else reason, layers["reason"]
        ),
    }


def random_bits(x: Any, y: Any, seed: Any, draw: Any) -> tuple[Words, Words, Words, Words]:
    """Compute four 32-bit random words per pixel (x, y), seed and draw, which broadcast."""
    xp = of(seed)
    # One step of a linear congruential generator for each word.
    a, b, c, d = (
        xp.words(n, seed) * xp.word(1664525) + xp.word(1013904223) for n in (x, y, seed, draw)
    )
    a, b, c, d = _scramble(a, b, c, d)
    return _scramble(*(word ^ xp.shifted(word, 16) for word in (a, b, c, d)))


def _scramble(a: Words, b: Words, c: Words, d: Words) -> tuple[Words, Words, Words, Words]:
    a = a + b * d
    b = b + c * a
    c = c + a * b
    return a, b, c, d + b * c


def pcg_word(word: Words) -> Words:
    """Return the next 32-bit word of the random generator PCG (RXS-M-XS 32)."""
    xp = of(word)
    state = word * xp.word(747796405) + xp.word(2891336453)
    by = xp.shifted(state, 28) + xp.word(4)
    mixed: Words = (xp.shifted(state, by) ^ state) * xp.word(277803737)
    return xp.shifted(mixed, 22) ^ mixed


def uniform01(bits: Words) -> Image:
    """Convert 32-bit words to uniform numbers in the open interval (0, 1), with 23 random bits."""
    xp = of(bits)
    return (xp.floats(xp.shifted(bits, 9)) + 0.5) * (1.0 / 8388608.0)


def normal_pair(first: Words, second: Words) -> tuple[Image, Image]:
    """Convert two random words to two independent standard normal numbers (Box-Muller)."""
    xp = of(first)
    radius = xp.sqrt(-2.0 * xp.log(uniform01(first)))
    angle = 6.28318530718 * uniform01(second)
    return radius * xp.cos(angle), radius * xp.sin(angle)


def correlated_noise(view: FrameContext, seed: Any) -> Image:
    """Sample (h, w) noise of variance 1, smoothed by the 3x3 filter of the Kinect's decoder."""
    xp = of(seed)
    left, top, width, height = view.window
    x, y = pixels(Rect(left - 1, top - 1, width + 2, height + 2), seed)
    row = pcg_word(xp.words(seed, seed) ^ pcg_word(xp.words(y)))
    bits = pcg_word(row + xp.words(x))
    white = xp.floats(xp.shifted(bits, 16) + (bits & xp.word(0xFFFF))) - 65535.0
    noise: Any = 0.0
    for dx, dy in square(1):
        part = white[..., 1 + dy : 1 + dy + height, 1 + dx : 1 + dx + width]
        noise = xp.plus(noise, KERNEL[abs(dx) + abs(dy)], part)
    smooth: Image = _CORRELATED_UNIT * noise
    return smooth


#: Scale that makes the variance 1: sqrt(6) / 65536 times KERNEL_UNIT. Both factors are rounded to
#: float32 before the product, as in the shader.
_CORRELATED_UNIT = float(of(0).float32(KERNEL_UNIT) * of(0).float32(3.73772e-5))


def deep(value: Any) -> Any:
    """Append an axis to one number per map, so that it broadcasts with arrays of components."""
    return value if isinstance(value, float) else value[..., None]
