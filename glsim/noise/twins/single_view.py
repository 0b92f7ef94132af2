"""Twins of single_view_match and single_view_noise, and of shaders/lib/support.glsl."""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, floor, pi, sin

from glsim.core.arrays import of
from glsim.core.reason import Reason
from glsim.noise.frame_context import FrameContext
from glsim.noise.twins.any_camera import incidence, lattice_noise
from glsim.noise.twins.batch import beside_camera
from glsim.noise.twins.layers import (
    Image,
    Layers,
    Parameters,
    around,
    disparity_px,
    has_depth,
    normal_pair,
    pixels,
    random_bits,
    select,
)


def single_view_match(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Finds the disparities of a stereo camera from the depth of its first view."""
    clean, fb = layers["clean"], view.focal_baseline_px_m
    xp, (axis, way, _) = of(clean), beside_camera(view.second_view_m)
    seen_px = xp.where(clean > 0, disparity_px(clean, fb), 0.0)
    rough = p["rough_px"] * lattice_noise(view, (p["rough_length_px"],) * 2, view.seed)
    growth = p["growth_px"] + rough, p["growth_in_shadow_px"] + rough
    disparity = _support(view, seen_px, _step(axis, way), growth, p)
    # March towards the imager, and keep the largest disparity; a pixel k px ahead counts k px less.
    column, row = pixels(view.window, view.seed)
    place = way * xp.floats(column if axis == -1 else row)
    nearest = xp.minimum(p["largest_px"], fb / max(view.nearest_m, 1e-3))
    ahead: Image = xp.minimum(seen_px, nearest) - place
    ahead = xp.flip(ahead, (axis,)) if way > 0 else ahead
    ahead = xp.running_maximum(ahead, axis)
    ahead = (xp.flip(ahead, (axis,)) if way > 0 else ahead) + place
    wider, (right, down) = int(p["shadow_px"]), _step(axis, way)
    seen_ahead = around(view, ahead, wider)(wider * right, wider * down)
    hidden = seen_ahead > disparity + p["rim_step_px"]
    size = view.width if axis == -1 else view.height
    beside = place if way > 0 else place + (size - 1.0)
    fate = select(
        [
            (disparity <= 0, float(Reason.NO_SURFACE)),
            (disparity > p["largest_px"], float(Reason.OUT_OF_RANGE)),
            (hidden | (beside < disparity + p["border_px"]), float(Reason.SHADOW)),
        ],
        xp.zeros_like(clean) + float(Reason.VALID),
    )
    return {"disparity": disparity, "fate": fate}


def _step(axis: int, way: int) -> tuple[int, int]:
    """Return the offset (dx, dy) of the next pixel along an image axis: -1 for x, -2 for y."""
    return (way, 0) if axis == -1 else (0, way)


def _support(
    view: FrameContext, px: Image, step: tuple[int, int], growth_px: Sequence[Image], p: Parameters
) -> Image:
    """Return the disparities, px, that matching windows find along one axis; 0 = none.

    Args:
        px: disparities of the surfaces, px, 0 = none.
        step: offset (dx, dy) of the next pixel along the axis.
        growth_px: widths by which near surfaces grow backwards and forwards along the axis, px.
    """
    xp, reach, apart_px = of(px), int(p["support_px"]) // 2, p["support_step_px"]
    front, total, count, neighbour = px, px, xp.floats(px > 0), around(view, px, reach)
    for k in range(1, 2 * reach + 1):
        away = (k + 1) // 2
        far, growth = (-away, growth_px[0]) if k % 2 == 1 else (away, growth_px[1])
        there = neighbour(far * step[0], far * step[1])
        nearer = (there > front + apart_px) & (growth >= away)
        alike = (there > 0) & (xp.abs(there - front) < apart_px)
        total = xp.where(nearer, there, total + xp.where(alike, there, 0.0))
        count = xp.where(nearer, 1.0, count + xp.floats(alike))
        front = xp.where(nearer, there, front)
    return total / xp.maximum(count, 1.0)


def single_view_noise(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds the noise and the losses of a stereo camera, and rounds disparities."""
    clean, before, fb = layers["clean"], layers["disparity"], view.focal_baseline_px_m
    xp, (axis, _, _) = of(clean), beside_camera(view.second_view_m)
    bumps = lattice_noise(view, (p["rough_length_px"],) * 2, view.seed)
    growth = p["growth_across_px"] + p["rough_px"] * bumps
    own = _support(view, before, _step(-3 - axis, 1), (growth, growth), p)
    rim = p["rim_px"]
    around_rim = around(view, before, floor(rim + 0.5))
    near = xp.zeros_like(clean)
    for k in range(8):
        dx, dy = (floor(rim * way(k * pi / 4) + 0.5) for way in (cos, sin))
        near = xp.maximum(near, around_rim(dx, dy))

    z = fb / xp.maximum(own, 1e-3)
    spacing = p["length_along_px"], p["length_across_px"]
    spacing = spacing if axis == -1 else spacing[::-1]
    by_distance = p["sigma_px_per_m"] * p["sigma_px_per_m"] * z * z
    sigma = xp.sqrt(p["sigma_px"] * p["sigma_px"] + by_distance)
    sigma = xp.minimum(sigma, p["most_sigma_px"])
    bits = random_bits(*pixels(view.window, view.seed), view.seed, 0)
    noise = xp.sqrt(1.0 - p["white_share"]) * lattice_noise(view, spacing, view.seed + 1)
    noise = noise + xp.sqrt(p["white_share"]) * normal_pair(bits[0], bits[1])[0]
    noise = noise * sigma * xp.exp(p["tail"] * bumps - p["tail"] * p["tail"])
    device = p["device_sigma_px"] * lattice_noise(view, spacing, view.device_seed)
    found = own + noise + device
    steps = xp.maximum(xp.floor(p["steps_per_px"] * found + 0.5), 1.0)

    cosine, _, _ = incidence(layers["normal"], layers["rays"])
    light = layers["albedo"] * xp.maximum(cosine, 0.0) / xp.maximum(clean, 1e-3)
    limit = p["dark_albedo"] * xp.exp(p["dark_spread"] * bumps)

    fate = layers["fate"]
    elsewhere = xp.abs(own - fb / xp.maximum(clean, 1e-3)) > p["support_step_px"]
    grown = own > before + p["support_step_px"]
    reason = select(
        [
            ((fate != Reason.VALID) & ~grown, fate),
            (near > own + p["rim_step_px"], float(Reason.EDGE)),
            (clean <= 0, float(Reason.GROWN)),
            (elsewhere, float(Reason.MOVED)),
            (light < limit, float(Reason.LOW_SIGNAL)),
        ],
        xp.zeros_like(clean) + float(Reason.VALID),
    )
    depth = xp.where(has_depth(reason), fb * p["steps_per_px"] / steps, 0.0)
    return {"depth": depth, "reason": reason}
