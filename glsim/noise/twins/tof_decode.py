"""Twins of the time-of-flight stages that decode light: taps, filters, unwrapping, tof_fast."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from glsim.core.array_types import Mask
from glsim.core.arrays import of
from glsim.core.reason import Reason
from glsim.noise.frame_context import FrameContext
from glsim.noise.twins.layers import (
    KERNEL,
    KERNEL_UNIT,
    Image,
    Layers,
    Neighbours,
    Parameters,
    around,
    correlated_noise,
    deep,
    moved_by_mm,
    normal_pair,
    padded,
    pixels,
    random_bits,
    select,
    square,
    value_range,
    where_worthwhile,
    without,
)
from glsim.noise.twins.tof_light import (
    HALF_WAVE_M_MHZ,
    TWO_PI,
    along_axis,
    distance_of,
    expected_depth,
    frequencies,
    packed,
    phases,
    phasors,
    unwrapped_cycles,
)

#: Weight of each frequency (libfreenect2: ab_multiplier_per_frq); cosines, sines of tap phases.
CONTRAST_MULTIPLIER = np.array([1.322581, 1.0, 1.612903], np.float32)
TAP_COS, TAP_SIN = (1.0, -0.5, -0.5), (0.0, 0.86602540378, -0.86602540378)
#: The largest tap that the 11-bit code represents (libfreenect2's lookup table).
LARGEST_TAP = 16320.0
_COUNTS_PER_AMPLITUDE, _LIMIT = 16.0, 65535.0
#: Halo of the lens: distance -> weight along an axis within 3x3.
_HALO = {0: 0.332485, 1: 0.234939}
_HALO_OUTER = 0.0891
#: Blur of tof_fast: distance -> weight along an axis.
_BLUR = {0: 0.8, 1: 0.1}
#: Distance -> weight along an axis; the products of two weights are KERNEL within 1e-7.
_KERNEL_ALONG = tuple(KERNEL[k] / KERNEL[0] ** 0.5 for k in (0, 1))
_STEEPEST = 12.0
_LOG2_E, _LOG10_2, _LOG2_10 = 1.442695, 0.301030, 3.321928
_TINY, _HALF_ROOT_3 = 1e-20, 0.86602540378


def _parts(layers: Layers) -> tuple[Image, Image]:
    """Return the real and the imaginary parts of the phasors, each (..., 3)."""
    a, b = layers["phasor_a"], layers["phasor_b"]
    xp = of(a)
    real = xp.stack([a[..., 0], a[..., 2], b[..., 0]], -1)
    return real, xp.stack([a[..., 1], a[..., 3], b[..., 1]], -1)


def _bilateral(
    view: FrameContext, p: Parameters, layers: Layers, sharpness: Any, along: Sequence[Any],
    clamped: bool,
) -> tuple[Image, Image, Image, Any]:  # fmt: skip
    """Average phasors over a square; neighbours of different phase weigh less.

    Bright pixels average bright neighbours. A pixel below ``min_amplitude`` averages all its
    neighbours, whatever their phase.

    Args:
        sharpness: decay of the weight with the phase distance, 0 for equal, 1 for opposite ones.
        along: weights along an axis, by distance.
        clamped: as in ``padded``.

    Returns:
        Real parts, imaginary parts, sum of the phase distances, and number of neighbours.
    """
    real, imaginary = _parts(layers)
    xp, reach = of(real), len(along) - 1
    height, width = real.shape[-3:-1]
    norm = real * real + imaginary * imaginary
    bright = norm >= deep(p["min_amplitude"]) * deep(p["min_amplitude"])
    unit, seen = 1.0 / xp.sqrt(xp.maximum(norm, _TINY)), xp.floats(bright)
    own_x, own_y = real * unit, imaginary * unit
    dark = [padded(view, part, reach, clamped=clamped) for part in (real, imaginary, own_x, own_y)]
    count = padded(view, seen, reach, clamped=clamped)
    lights = r, i, x, y = [part * count for part in dark]
    sharp_x, sharp_y = 0.5 * sharpness * x, 0.5 * sharpness * y

    def part(layer: Image, right: int, down: int, wider: int = 0, lower: int = 0) -> Image:
        return layer[..., down : down + height + lower, right : right + width + wider, :]

    def summed(layer: Image, weights: Sequence[Any]) -> Any:
        rows: Any = 0.0
        total: Any = 0.0
        for k in range(-reach, reach + 1):
            rows = xp.plus(rows, weights[abs(k)], layer[..., reach + k : reach + k + height, :, :])
        for k in range(-reach, reach + 1):
            total = xp.plus(total, weights[abs(k)], rows[..., reach + k : reach + k + width, :])
        return total

    sums: list[Image] = [xp.zeros_like(real)] * 3
    for dx, dy in (to for to in square(reach) if to[::-1] > (0, 0)):
        # Two neighbours give each other the same weight: compute it once.
        ahead, behind = max(dx, 0), max(-dx, 0)
        first = reach - ahead, reach - dy, abs(dx), dy
        second = reach + dx - ahead, reach, abs(dx), dy
        near_x = part(sharp_x, *first) * part(x, *second)
        alike = xp.exp(xp.plus(near_x, part(sharp_y, *first), part(y, *second)))
        for sign, weight in ((1, part(alike, ahead, dy)), (-1, part(alike, behind, 0))):
            to = reach + sign * dx, reach + sign * dy
            sums = [
                xp.plus(total, weight, part(layer, *to), along[abs(dx)] * along[dy])
                for total, layer in zip(sums, (r, i, count), strict=True)
            ]
    own, falls = along[0] * along[0], xp.exp(-0.5 * sharpness)
    total = own + falls * sums[2]
    all_in_one, flat = (along[0] + 2.0 * sum(along[1:])) ** 2, [1.0] * len(along)
    real, imaginary = (
        xp.where(bright, (own * here + falls * light) / total, summed(layer, along) / all_in_one)
        for here, light, layer in zip((real, imaginary), sums[:2], dark[:2], strict=True)
    )
    near = xp.where(bright, summed(count, flat), float((2 * reach + 1) ** 2))
    mean_x, mean_y = (
        xp.where(bright, summed(light, flat), summed(layer, flat))
        for light, layer in zip(lights[2:], dark[2:], strict=True)
    )
    return real, imaginary, 0.5 * (near - own_x * mean_x - own_y * mean_y), near


def _filtered(
    layers: Layers, kept: Mask, marked: Mask, real: Image, imaginary: Image
) -> dict[str, Image]:
    """Pack filtered phasors into their layers, together with infrared counts and flags.

    Args:
        layers: the layers before the filter.
        kept: mask of the pixels that stay unfiltered.
        marked: mask of edges, which adds 1 to the flags (2 = saturated).
        real, imaginary: filtered parts, each (..., 3).
    """
    xp, b, keep = of(real), layers["phasor_b"], kept[..., None]
    own_real, own_imaginary = _parts(layers)
    return packed(
        "phasor",
        xp.where(keep, own_real, real),
        xp.where(keep, own_imaginary, imaginary),
        b[..., 2],
        b[..., 3] + xp.floats(marked & ~kept),
    )


def companded(taps: Image) -> Image:
    """Round taps to the values that the Kinect's 11-bit code can represent."""
    xp = of(taps)
    size = xp.minimum(xp.abs(taps), LARGEST_TAP)
    # A float's exponent bits alone are the next lower power of 2; the code adds 7 bits.
    power = (size.view(xp.int32) & 0x7F800000).view(xp.float32)
    step = xp.maximum(power / 128.0, 1.0)
    rounded = xp.minimum(xp.floor(size / step + 0.5) * step, LARGEST_TAP)
    return xp.sign(taps) * rounded


def tof_taps(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Simulates noisy taps, and combines them into one phasor per frequency."""
    light, beside_light = _blurred(view, layers, p)
    amplitude, (x, y) = light[..., 6], pixels(view.window, view.seed)
    xp = of(amplitude)
    seen = beside_light | (layers["clean"] > 0)
    saturated = seen & False
    reals: list[Image] = []
    imaginaries: list[Image] = []
    for k, m in enumerate(CONTRAST_MULTIPLIER.tolist()):
        bits = random_bits(x, y, view.seed, k)
        light_lsb = amplitude / m + p["ambient_lsb"]
        day = p["daylight"] * p["daylight_lsb"]
        sigma = xp.sqrt(p["read_variance"] + p["shot_variance"] * light_lsb + day * day)
        taps = []
        noise = *normal_pair(*bits[:2]), normal_pair(*bits[2:])[0]
        for c, s, white in zip(TAP_COS, TAP_SIN, noise, strict=True):
            tap = (light[..., 2 * k] * c - light[..., 2 * k + 1] * s) / m + sigma * white
            saturated = saturated | (xp.abs(tap) > p["saturation_lsb"])
            taps.append(companded(tap) if p["companding"] else tap)
        scale = float(np.float32(m) * np.float32(2.0) / np.float32(3.0))
        reals.append(scale * (taps[0] * TAP_COS[0] + taps[1] * TAP_COS[1] + taps[2] * TAP_COS[2]))
        imaginaries.append(-scale * (taps[0] * 0.0 + taps[1] * TAP_SIN[1] + taps[2] * TAP_SIN[2]))
    border = ((x == 0) | (x == view.width - 1)) & (p["dead_border"] > 0)
    read = seen & ~border
    sizes = [xp.sqrt(r * r + i * i) for r, i in zip(reals, imaginaries, strict=True)]
    mean = (sizes[0] + sizes[1] + sizes[2]) / 3.0
    infrared = xp.where(saturated, _LIMIT, xp.minimum(_COUNTS_PER_AMPLITUDE * mean, _LIMIT))
    valid = (read & ~saturated)[..., None]
    counts = xp.where(read, infrared, 0.0)
    flags = xp.where(read & saturated, 2.0, 0.0)
    real, imaginary = (xp.where(valid, xp.stack(part, -1), 0.0) for part in (reals, imaginaries))
    return packed("phasor", real, imaginary, counts, flags)


def _blurred(view: FrameContext, layers: Layers, p: Parameters) -> tuple[Image, Mask]:
    """Blur the light, (..., 7) phasors and amplitude; also mark the pixels with light in 3 x 3."""
    a, b = layers["light_a"], layers["light_b"]
    xp = of(a)
    planes = [*(a[..., k] for k in range(4)), *(b[..., k] for k in range(3))]
    light = around(view, xp.stack(planes, -1), 4, clamped=True)
    side = 0.5 * p["psf_sigma_px"] * p["psf_sigma_px"]
    weight = {0: 1.0 - 2.0 * side, 1: side}
    core = 1.0 - p["halo"] - p["haze"]
    total = late = haze = xp.zeros_like(light(0, 0))
    for dx, dy in square(1):
        part = light(dx, dy)
        total = xp.plus(total, deep(core * weight[abs(dx)] * weight[abs(dy)]), part)
        late = xp.plus(late, deep(p["halo"] * _HALO[abs(dx)] * _HALO[abs(dy)]), part)
    beside_light = total[..., 6] + late[..., 6] > 0
    for dx, dy in ((-2, 0), (2, 0), (0, -2), (0, 2)):
        late = xp.plus(late, deep(_HALO_OUTER * p["halo"]), light(dx, dy))
    for dx, dy in ((-4, -4), (4, -4), (-4, 4), (4, 4)):
        haze = xp.plus(haze, deep(0.25 * p["haze"]), light(dx, dy))
    f = xp.vector(frequencies(view), total)
    later = deep(TWO_PI * 0.001 * p["halo_delay_mm"]) * f / HALF_WAVE_M_MHZ
    c, s = xp.cos(later), xp.sin(later)
    late = _turned(late, c, s)
    real, imaginary = deep(core) + deep(p["halo"]) * c, deep(p["halo"]) * s
    size = xp.sqrt(real * real + imaginary * imaginary)
    return _turned(total + late, real / size, -imaginary / size) + haze, beside_light


def _turned(light: Image, c: Image, s: Image) -> Image:
    """Rotate the phasors of (..., 7) light; c and s are each frequency's cosine and sine, (3,)."""
    turned = []
    for k in range(3):
        real, imaginary = light[..., 2 * k], light[..., 2 * k + 1]
        turned += [
            real * c[..., k] - imaginary * s[..., k],
            real * s[..., k] + imaginary * c[..., k],
        ]
    return of(light).stack([*turned, light[..., 6]], -1)


def tof_bilateral(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Averages phasors over 3x3 pixels; neighbours of different phase weigh less."""
    sharpness = deep(_LOG2_E * p["sharpness"])
    real, imaginary, apart, _ = _bilateral(view, p, layers, sharpness, _KERNEL_ALONG, False)
    kept = ~(layers["phasor_b"][..., 2] > 0) | _border(view)
    return _filtered(layers, kept, of(real).amax(apart, -1) >= p["max_edge"], real, imaginary)


def tof_smooth(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Averages phasors over 7x7 pixels; neighbours of different phase weigh less."""
    falloff, xp = deep(-0.5 / (p["width_px"] * p["width_px"])), of(layers["phasor_b"])
    along = [1.0, *(xp.exp(falloff * float(k * k)) for k in (1, 2, 3))]
    real, imaginary, apart, near = _bilateral(view, p, layers, deep(p["sharpness"]), along, True)
    kept, marked = layers["phasor_b"][..., 2] <= 0, xp.amax(apart / near, -1) >= p["max_apart"]
    return _filtered(layers, kept, marked, real, imaginary)


def tof_unwrap(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Unwraps the phases of three frequencies to depth along the axis."""
    b = layers["phasor_b"]
    z, reason, sums = decoded(view, layers, p, *_parts(layers))
    xp, flags = of(z), b[..., 3]
    reason = xp.where(flags >= 2, float(Reason.SATURATED), reason)
    depth = xp.where((reason == Reason.VALID) | (reason == Reason.GROWN), z, 0.0)
    usable = xp.where((flags == 1) | (flags == 3), 0.0, depth)
    return {
        "depth": depth,
        "reason": reason,
        "infrared": b[..., 2],
        "decoded": xp.stack([usable, sums], -1),
    }


def decoded(
    view: FrameContext, layers: Layers, p: Parameters, real: Image, imaginary: Image
) -> tuple[Image, Image, Image]:
    """Decode phasor parts, (..., 3), to depth, m; reason code; sum of the three amplitudes."""
    xp, f = of(real), frequencies(view)
    amplitude = xp.sqrt(real * real + imaginary * imaginary)
    fast, slow, third = unwrapped_cycles(phases(real, imaginary), f)
    x, y, w = (f / np.sqrt((f * f).sum())).tolist()
    u, v, t = TWO_PI * fast, TWO_PI * slow, TWO_PI * third
    cross = v * w - t * y, t * x - u * w, u * y - v * x
    disagreement = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]
    most = xp.maximum(xp.amax(amplitude, -1), 1e-6)
    power = (xp.log(most) * p["slope"] * _LOG10_2 + p["offset"]) * _LOG2_10
    allowed = xp.clip(xp.exp(power), p["min_disagreement"], p["max_disagreement"])
    z = along_axis(view, layers["rays"], distance_of(fast, slow, third, f))
    clean, sums = layers["clean"], amplitude[..., 0] + amplitude[..., 1] + amplitude[..., 2]
    dark = (xp.amin(amplitude, -1) < p["min_amplitude"]) | (sums < p["min_sum"])
    wrong = (disagreement > allowed * allowed) | (z <= 0)
    empty, unlit = clean <= 0, layers["lit"] < 0.5
    reason = select(
        [
            (dark & empty, float(Reason.NO_SURFACE)),
            ((dark | wrong) & ~empty & unlit, float(Reason.SHADOW)),
            (dark, float(Reason.LOW_SIGNAL)),
            (wrong, float(Reason.UNWRAP)),
            (empty, float(Reason.GROWN)),
        ],
        xp.zeros_like(z) + float(Reason.VALID),
    )
    return z, reason, sums


def tof_edge(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels between two surfaces and pixels that the bilateral filter marked."""
    own, z = layers["decoded"], layers["depth"]
    xp, sums, low, high = of(z), own[..., 1], z, z
    marked = xp.floats(own[..., 0] <= 0)
    depths, amplitudes = (around(view, own[..., k], 1) for k in (0, 1))
    squares = sums * sums
    for dx, dy in (to for to in square(1) if to != (0, 0)):
        amplitude, there = amplitudes(dx, dy), depths(dx, dy)
        sums = sums + amplitude
        squares = squares + amplitude * amplitude
        marked = marked + xp.floats(there <= 0)
        there = xp.where(there > 0, there, z)
        low, high = xp.minimum(low, there), xp.maximum(high, there)
    spread = xp.sqrt(xp.maximum(9.0 * squares - sums * sums, 0.0)) / 9.0
    contrast = spread / xp.maximum(sums / 9.0, p["min_mean"])
    near, far = 1000.0 * (z - low), 1000.0 * (high - z)
    between = (contrast >= p["min_contrast"]) & (near > p["nearest_mm"])
    between = between & (far > p["farthest_mm"]) & (xp.maximum(near, far) > p["larger_mm"])
    least = xp.where(own[..., 0] <= 0, p["least_marked"], 10.0 - p["least_marked"])
    mixed = marked >= least
    lost = ~_border(view) & (between | (mixed & (p["remove_mixed"] > 0)))
    return without(layers, lost, xp.where(between, float(Reason.EDGE), float(Reason.MIXED)))


def tof_floor(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds noise that does not depend on the light and is correlated between neighbours."""
    depth = layers["depth"]
    sigma = of(depth).sqrt(floor_variance(view, layers, p, depth))
    return {"depth": moved_by_mm(depth, sigma * correlated_noise(view, view.seed))}


def floor_variance(view: FrameContext, layers: Layers, p: Parameters, depth_m: Image) -> Image:
    """Compute the variance, mm^2, of the noise that does not depend on the light."""
    normal, rays, xp = layers["normal"], layers["rays"], of(depth_m)
    facing = normal[..., 0] * rays[..., 0] + normal[..., 1] * rays[..., 1] + normal[..., 2]
    aside = xp.sqrt(normal[..., 0] * normal[..., 0] + normal[..., 1] * normal[..., 1])
    slope = xp.minimum(aside / xp.maximum(-facing, 1e-3), _STEEPEST)
    slanted = p["lateral_px"] * slope * 1000.0 * depth_m / view.focal_px
    return p["sigma_mm"] * p["sigma_mm"] + slanted * slanted


def _border(view: FrameContext) -> Mask:
    """Mark the outermost pixels of the frame, which the decoder does not filter."""
    x, y = pixels(view.window, view.seed)
    outermost: Mask = (x == 0) | (x == view.width - 1) | (y == 0) | (y == view.height - 1)
    return outermost


def field_stop(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes depth and infrared outside the lens's field of view."""
    x, y = layers["rays"][..., 0], layers["rays"][..., 1]
    xp, r2, lens = of(x), x * x + y * y, view.lens
    upper, lower = (
        1.0 + r2 * (a + r2 * (b + r2 * c))
        for a, b, c in ((lens.k1, lens.k2, lens.k3), (lens.k4, lens.k5, lens.k6))
    )
    across = xp.abs(x * (upper / lower) - p["centre_x"])
    down = xp.abs(y * (upper / lower) - p["centre_y"])
    out_by = xp.maximum(down, _HALF_ROOT_3 * across + 0.5 * down)
    outside = (p["side"] > 0) & (out_by > p["side"])
    lost = outside | (r2 >= p["widest_tan"] * p["widest_tan"])
    known = layers["reason"] == Reason.NO_SURFACE
    why = xp.where(known, layers["reason"], float(Reason.LOW_SIGNAL))
    return {
        "depth": xp.where(lost, 0.0, layers["depth"]),
        "reason": xp.where(lost, why, layers["reason"]),
        "infrared": xp.where(lost, 0.0, layers["infrared"]),
    }


def tof_fast(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds noise of known statistics on even surfaces; adds up phasors beside depth steps."""
    clean, lit = layers["clean"], layers["lit"]
    xp, at_step = of(clean), value_range(view, clean, 1) > 0.001 * p["step_mm"]
    seen = phasors(view, p, clean, layers["normal"], layers["rays"], lit)
    seed: Any = view.seed
    x, y = pixels(view.window, seed)
    white = normal_pair(*random_bits(x, y, seed, 1)[:2])[0]
    sigma = _part_sigma(p, seen[2])
    dimmed = seen[2] + xp.amax(sigma, -1) * white
    kept = xp.where(dimmed < 1.1 * p["min_amplitude"], 0.0, 1.0)[..., None]
    even: list[Any] = [kept * seen[0], kept * seen[1], seen[2], sigma, at_step & False]
    at, own_p = where_worthwhile(view, at_step, p)
    if at is not None:
        x, y, seed = xp.words(at[2]), xp.words(at[1]), seed.expand(len(clean), 1, 1)[at[0], 0, 0]
    there = [around(view, part, 1, clamped=True, at=at) for part in seen]
    for part, values in zip(even, _at_steps(own_p, there, (x, y, seed)), strict=True):
        if at is not None:
            part[at] = values
        else:
            chosen = at_step[..., None] if part.ndim > at_step.ndim else at_step
            part[...] = xp.where(chosen, values, part)
    real, imaginary, amplitude, sigma, marked = even
    z, reason, sums = decoded(view, layers, p, real, imaginary)
    reason = xp.where((amplitude <= 0) & (clean <= 0), float(Reason.NO_SURFACE), reason)
    reason = xp.where(amplitude > p["saturation_lsb"], float(Reason.SATURATED), reason)
    valid = (reason == Reason.VALID) | (reason == Reason.GROWN)
    turns = xp.sqrt((sigma * sigma).sum(-1)) / xp.maximum(amplitude, 1.0) / TWO_PI
    light_mm: Image = 1000.0 * turns * HALF_WAVE_M_MHZ / float(frequencies(view).sum())
    ray_x, ray_y = layers["rays"][..., 0], layers["rays"][..., 1]
    # Convert the error along the ray to an error along z.
    light_mm = light_mm / xp.sqrt(ray_x * ray_x + ray_y * ray_y + 1.0)
    light_mm = xp.where(at_step, 0.0, light_mm)
    spread = xp.sqrt(floor_variance(view, layers, p, z) + light_mm * light_mm)
    z = xp.where(valid, z, 0.0)
    noisy = xp.where(valid, spread, 0.0) * correlated_noise(view, view.seed)
    depth = moved_by_mm(z, noisy)
    return {
        "depth": depth,
        "reason": reason,
        "infrared": xp.minimum(16.0 * amplitude, 65535.0),
        "decoded": xp.stack([xp.where(marked, 0.0, depth), sums], -1),
        **expected_depth(view, p, layers),
    }


def _part_sigma(p: Parameters, amplitude: Image) -> Image:
    """Compute the noise's standard deviation in the filtered phasors' parts, (..., 3)."""
    xp, read, shot = of(amplitude), p["read_variance"], p["shot_variance"]
    return xp.stack(
        [
            xp.sqrt(2 / 3 * m * m * (read + shot * (amplitude / m))) / KERNEL_UNIT
            for m in xp.vector(CONTRAST_MULTIPLIER, amplitude)
        ],
        -1,
    )


def _at_steps(
    p: Parameters, there: Sequence[Neighbours], random: tuple[Any, Any, Any]
) -> list[Any]:
    """Blur, filter and add noise to the phasors of pixels beside depth steps.

    ``there`` are three functions (dx, dy) -> real part, imaginary part and amplitude at that
    offset. ``random`` is the column, row and seed of the noise. Returns real parts, imaginary
    parts, amplitude, standard deviation of the parts, and the edge mask.
    """
    xp = of(there[2](0, 0))
    blurred: list[Any] = [0.0, 0.0, 0.0]
    for dx, dy in square(1):
        weight = float(np.float32(_BLUR[abs(dx)]) * np.float32(_BLUR[abs(dy)]))
        blurred = [
            xp.plus(total, weight, part(dx, dy)) for total, part in zip(blurred, there, strict=True)
        ]
    real, imaginary, amplitude = blurred
    least, sharpness = deep(p["min_amplitude"]), deep(-_LOG2_E * p["sharpness"])
    unit = 1.0 / xp.sqrt(xp.maximum(real * real + imaginary * imaginary, _TINY))
    bright = amplitude[..., None] >= least
    apart = xp.zeros_like(real)
    total = apart + KERNEL[0]
    sum_real, sum_imaginary = KERNEL[0] * real, KERNEL[0] * imaginary
    for dx, dy in (offset for offset in square(1) if offset != (0, 0)):
        light = there[2](dx, dy)[..., None]
        safe = xp.where(light > 0, light, 1.0)
        r, i = there[0](dx, dy) / safe, there[1](dx, dy) / safe
        away = 0.5 - 0.5 * (real * r + imaginary * i) * unit
        counts = xp.where((light >= least) | ~bright, 1.0, 0.0)
        falls = xp.where(bright, xp.exp(sharpness * away), 1.0)
        share = counts * KERNEL[abs(dx) + abs(dy)] * falls
        apart = apart + counts * away
        sum_real = sum_real + share * light * r
        sum_imaginary = sum_imaginary + share * light * i
        total = total + share
    sigma = _part_sigma(p, amplitude)
    noise = [normal_pair(*random_bits(*random, 1 + k)[:2]) for k in range(3)]
    return [
        sum_real / total + sigma * xp.stack([pair[0] for pair in noise], -1),
        sum_imaginary / total + sigma * xp.stack([pair[1] for pair in noise], -1),
        amplitude,
        sigma,
        xp.amax(apart, -1) >= p["max_edge"],
    ]
