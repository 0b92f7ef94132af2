"""NumPy twins of time-of-flight stages that decode light: taps, filters, unwrapping, tof_fast."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from glsim.core.reason import Reason
from glsim.noise.frame_context import FrameContext, Layers
from glsim.noise.numpy_twins.layers import (
    KERNEL,
    KERNEL_UNIT,
    Image,
    Parameters,
    beside,
    correlated_noise,
    moved_by_mm,
    normal_pair,
    pixels,
    random_bits,
    square,
    without,
)
from glsim.noise.numpy_twins.tof_light import (
    TWO_PI,
    along_axis,
    distance_of,
    expected_depth,
    frequencies,
    half_wave_m_mhz,
    phases,
    phasors,
    unwrapped_cycles,
)

Mask = NDArray[np.bool_]
Numbers = NDArray[np.floating]

#: libfreenect2's ab_multiplier_per_frq, and the phases of the taps.
CONTRAST_MULTIPLIER = np.array([1.322581, 1.0, 1.612903], np.float32)
TAP_COS = np.array([1.0, -0.5, -0.5], np.float32)
TAP_SIN = np.array([0.0, 0.86602540378, -0.86602540378], np.float32)
#: The largest value of the 11-bit code (libfreenect2's lookup table).
LARGEST_TAP = np.float32(16320.0)
_COUNTS_PER_AMPLITUDE = np.float32(16.0)
_LIMIT = np.float32(65535.0)
#: The halo: weights per axis within 3x3, of the four pixels at a distance of 2.
_HALO = {0: np.float32(0.332485), 1: np.float32(0.234939)}
_HALO_OUTER = np.float32(0.0891)
#: Weights per axis of tof_fast's blur.
_BLUR = {0: np.float32(0.8), 1: np.float32(0.1)}
_STEEPEST = np.float32(12.0)
_LOG2_E, _LOG10_2, _LOG2_10 = np.float32(1.442695), np.float32(0.301030), np.float32(3.321928)
_TINY, _ZERO, _HALF, _ONE = np.float32(1e-20), np.float32(0.0), np.float32(0.5), np.float32(1.0)
_HALF_ROOT_3 = np.float32(0.86602540378)


def _parts(layers: Layers) -> tuple[Image, Image]:
    """Return the real and the imaginary parts of the phasors, (h, w, 3) each."""
    a, b = layers["phasor_a"], layers["phasor_b"]
    real = np.stack([a[..., 0], a[..., 2], b[..., 0]], axis=-1)
    return real, np.stack([a[..., 1], a[..., 3], b[..., 1]], axis=-1)


def _layers(real: Numbers, imaginary: Numbers, counts: Image, flags: Image) -> dict[str, Image]:
    """Pack phasors, infrared counts and flags (1 edge, 2 saturated) into two (h, w, 4) layers."""
    both = np.stack([real, imaginary], axis=-1).reshape(*counts.shape, 6)
    b = np.concatenate([both[..., 4:], counts[..., None], flags[..., None]], axis=-1)
    return {"phasor_a": both[..., :4], "phasor_b": b}


def _alike(
    view: FrameContext, p: Parameters, real: Image, imaginary: Image, reach: int, clamped: bool
) -> Iterator[tuple[int, int, Image, Image, Image, Numbers, Numbers]]:
    """Yield for each neighbour: dx, dy, its phasor, whether it is bright enough, phase distances.

    The first distance is 0 for the same phase and 1 for the opposite one; the second is 0 at pixels
    that are too dark themselves.
    """
    norm = real * real + imaginary * imaginary
    unit = _ONE / np.sqrt(np.maximum(norm, _TINY))
    bright = (norm >= p["min_amplitude"] * p["min_amplitude"]).astype(np.float32)
    least = bright * p["min_amplitude"] * p["min_amplitude"]
    for dx, dy in square(reach):
        r, i = (beside(view, part, dx, dy, clamped=clamped) for part in (real, imaginary))
        other = r * r + i * i
        alike = (real * r + imaginary * i) * unit * (_ONE / np.sqrt(np.maximum(other, _TINY)))
        away = _HALF - _HALF * alike
        yield dx, dy, r, i, (other >= least).astype(np.float32), away, bright * away


def _filtered(
    layers: Layers, kept: Mask, marked: Mask, real: Numbers, imaginary: Numbers
) -> dict[str, Image]:
    """Return the phasor layers after a filter; pixels in ``kept`` stay as they were before it."""
    b, (own_real, own_imaginary), keep = layers["phasor_b"], _parts(layers), kept[..., None]
    return _layers(
        np.where(keep, own_real, real),
        np.where(keep, own_imaginary, imaginary),
        b[..., 2],
        b[..., 3] + (marked & ~kept).astype(np.float32),
    )


def companded(taps: Image) -> Image:
    """Round taps to the values that the Kinect's 11-bit code can represent."""
    size = np.minimum(np.abs(taps), LARGEST_TAP)
    exponent = np.frexp(size)[1] - 1
    step = np.ldexp(np.float32(1.0), np.maximum(exponent - 7, 0)).astype(np.float32)
    rounded = np.minimum(np.floor(size / step + np.float32(0.5)) * step, LARGEST_TAP)
    result: Image = np.sign(taps) * rounded
    return result


def tof_taps(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Simulates noisy taps, and combines them into one phasor per frequency."""
    both = np.concatenate([layers["light_a"], layers["light_b"]], -1)
    light, beside_light = _blurred(view, both, p)
    shot = light[..., 6:7] / CONTRAST_MULTIPLIER + p["ambient_lsb"]
    sigma = np.sqrt(p["read_variance"] + p["shot_variance"] * shot)
    seen = beside_light | (layers["clean"] > 0)
    x, y = pixels(view.window)
    taps = np.zeros((*seen.shape, 3, 3), np.float32)
    for k in range(3):
        bits = random_bits(x, y, view.seed, k)
        noise = np.stack([*normal_pair(*bits[:2]), normal_pair(*bits[2:])[0]], axis=-1)
        real, imaginary = light[..., 2 * k, None], light[..., 2 * k + 1, None]
        pure = (real * TAP_COS - imaginary * TAP_SIN) / CONTRAST_MULTIPLIER[k]
        taps[..., k, :] = pure + sigma[..., k, None] * noise
    saturated = (np.abs(taps) > p["saturation_lsb"]).any(axis=(-1, -2))
    if p["companding"]:
        taps = companded(taps)
    border = ((x == 0) | (x == view.width - 1)) & (p["dead_border"] > 0)
    read = seen & ~border
    scale = CONTRAST_MULTIPLIER * np.float32(2.0) / np.float32(3.0)
    real, imaginary = scale * (taps * TAP_COS).sum(axis=-1), -scale * (taps * TAP_SIN).sum(axis=-1)
    amplitude = np.sqrt(real * real + imaginary * imaginary)
    mean = (amplitude[..., 0] + amplitude[..., 1] + amplitude[..., 2]) / np.float32(3.0)
    infrared = np.where(saturated, _LIMIT, np.minimum(_COUNTS_PER_AMPLITUDE * mean, _LIMIT))
    valid = (read & ~saturated)[..., None]
    counts = np.where(read, infrared, _ZERO)
    flags = np.where(read & saturated, np.float32(2.0), _ZERO)
    return _layers(np.where(valid, real, _ZERO), np.where(valid, imaginary, _ZERO), counts, flags)


def _blurred(view: FrameContext, light: Image, p: Parameters) -> tuple[Image, NDArray[np.bool_]]:
    """Blur light by the optics; return also whether a pixel or one of its 8 neighbours has light.

    0 outside the window, clamped at the frame.
    """
    side = _HALF * p["psf_sigma_px"] * p["psf_sigma_px"]
    weight = {0: _ONE - np.float32(2.0) * side, 1: side}
    core = _ONE - p["halo"] - p["haze"]
    total, late, haze = np.zeros_like(light), np.zeros_like(light), np.zeros_like(light)
    for dx, dy in square(1):
        part = beside(view, light, dx, dy, clamped=True)
        total += core * weight[abs(dx)] * weight[abs(dy)] * part
        late += p["halo"] * _HALO[abs(dx)] * _HALO[abs(dy)] * part
    beside_light = total[..., 6] + late[..., 6] > 0
    for dx, dy in ((-2, 0), (2, 0), (0, -2), (0, 2)):
        late += _HALO_OUTER * p["halo"] * beside(view, light, dx, dy, clamped=True)
    for dx, dy in ((-4, -4), (4, -4), (-4, 4), (4, 4)):
        haze += np.float32(0.25) * p["haze"] * beside(view, light, dx, dy, clamped=True)
    later = TWO_PI * np.float32(0.001) * p["halo_delay_mm"] * frequencies(view) / half_wave_m_mhz()
    late = _turned(late, np.cos(later), np.sin(later))
    real, imaginary = core + p["halo"] * np.cos(later), p["halo"] * np.sin(later)
    size = np.sqrt(real * real + imaginary * imaginary)
    return _turned(total + late, real / size, -imaginary / size) + haze, beside_light


def _turned(light: Image, c: Image, s: Image) -> Image:
    """Rotate the phasors of (h, w, 8) light by angles, given as cosine and sine per frequency."""
    turned = light.copy()
    real, imaginary = light[..., 0:6:2], light[..., 1:6:2]
    turned[..., 0:6:2] = real * c - imaginary * s
    turned[..., 1:6:2] = real * s + imaginary * c
    return turned


def tof_bilateral(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Averages phasors over 3x3 pixels; neighbours of different phase weigh less."""
    real, imaginary = _parts(layers)
    sum_real, sum_imaginary = KERNEL[0] * real, KERNEL[0] * imaginary
    total, apart = np.full_like(real, KERNEL[0]), np.zeros_like(real)
    for dx, dy, r, i, counts, away, bright_away in _alike(view, p, real, imaginary, 1, False):
        if dx or dy:
            falls = np.exp(-_LOG2_E * p["sharpness"] * bright_away)
            weight = counts * KERNEL[abs(dx) + abs(dy)] * falls
            apart += counts * away
            sum_real += weight * r
            sum_imaginary += weight * i
            total += weight
    kept = ~(layers["phasor_b"][..., 2] > 0) | _border(view)
    marked = apart.max(axis=-1) >= p["max_edge"]
    return _filtered(layers, kept, marked, sum_real / total, sum_imaginary / total)


def tof_smooth(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Averages phasors over 7x7 pixels; neighbours of different phase weigh less."""
    real, imaginary = _parts(layers)
    falloff = -_HALF / (p["width_px"] * p["width_px"])
    sum_real, sum_imaginary, total, apart, near = (np.zeros_like(real) for _ in range(5))
    near += np.float32(1e-6)
    for dx, dy, r, i, counts, away, bright_away in _alike(view, p, real, imaginary, 3, True):
        squared = np.float32(dx * dx + dy * dy)
        weight = counts * np.exp(falloff * squared - p["sharpness"] * bright_away)
        sum_real += weight * r
        sum_imaginary += weight * i
        total += weight
        apart += counts * away
        near += counts
    kept = ~(layers["phasor_b"][..., 2] > 0) | (total <= 0).any(axis=-1)
    marked = (apart / near).max(axis=-1) >= p["max_apart"]
    safe = np.where(total > 0, total, _ONE)
    return _filtered(layers, kept, marked, sum_real / safe, sum_imaginary / safe)


def tof_unwrap(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Unwraps the phases of three frequencies to depth along the axis."""
    b = layers["phasor_b"]
    z, reason, sums = decoded(view, layers, p, *_parts(layers))
    reason = np.where(b[..., 3] >= 2, np.float32(Reason.SATURATED), reason)
    depth = np.where((reason == Reason.VALID) | (reason == Reason.GROWN), z, _ZERO)
    edge = (b[..., 3] == 1) | (b[..., 3] == 3)
    return {
        "depth": depth,
        "reason": reason,
        "infrared": b[..., 2],
        "decoded": np.stack([np.where(edge, _ZERO, depth), sums], axis=-1),
    }


def decoded(
    view: FrameContext, layers: Layers, p: Parameters, real: Image, imaginary: Image
) -> tuple[Image, Image, Image]:
    """Decode phasor parts (..., 3) to depth (m), reason code and sum of the three amplitudes."""
    amplitude = np.sqrt(real * real + imaginary * imaginary)
    f = frequencies(view)
    fast, slow, third = unwrapped_cycles(phases(real, imaginary), f)
    x, y, w = f / np.sqrt((f * f).sum())
    u, v, t = TWO_PI * fast, TWO_PI * slow, TWO_PI * third
    cross = v * w - t * y, t * x - u * w, u * y - v * x
    disagreement = cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]
    most = np.maximum(amplitude.max(axis=-1), np.float32(1e-6))
    power = (np.log(most) * p["slope"] * _LOG10_2 + p["offset"]) * _LOG2_10
    allowed = np.clip(np.exp(power), p["min_disagreement"], p["max_disagreement"])
    z = along_axis(view, layers["rays"], distance_of(fast, slow, third, f))
    clean, sums = layers["clean"], amplitude[..., 0] + amplitude[..., 1] + amplitude[..., 2]
    dark = (amplitude.min(axis=-1) < p["min_amplitude"]) | (sums < p["min_sum"])
    why_dark = np.where(layers["lit"] < _HALF, Reason.SHADOW, Reason.LOW_SIGNAL)
    reason = np.select(
        [dark, (disagreement > allowed * allowed) | (z <= 0), clean <= 0],
        [
            np.where(clean <= 0, Reason.NO_SURFACE, why_dark),
            np.where((clean > 0) & (layers["lit"] < _HALF), Reason.SHADOW, Reason.UNWRAP),
            np.full(dark.shape, Reason.GROWN),
        ],
        default=Reason.VALID,
    )
    return z, reason.astype(np.float32), sums


def tof_edge(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes pixels between two surfaces and pixels that the bilateral filter marked."""
    own, z = layers["decoded"], layers["depth"]
    sums = own[..., 1].copy()
    squares, low, high = sums * sums, z.copy(), z.copy()
    for other in (beside(view, own, dx, dy) for dx, dy in square(1) if dx or dy):
        sums += other[..., 1]
        squares += other[..., 1] * other[..., 1]
        there = np.where(other[..., 0] > 0, other[..., 0], z)
        low, high = np.minimum(low, there), np.maximum(high, there)
    nine, mm = np.float32(9.0), np.float32(1000.0)
    spread = np.sqrt(np.maximum(nine * squares - sums * sums, _ZERO)) / nine
    contrast = spread / np.maximum(sums / nine, p["min_mean"])
    near, far = mm * (z - low), mm * (high - z)
    between = (contrast >= p["min_contrast"]) & (near > p["nearest_mm"])
    between &= (far > p["farthest_mm"]) & (np.maximum(near, far) > p["larger_mm"])
    lost = ~_border(view) & (between | ((own[..., 0] <= 0) & (p["remove_mixed"] > 0)))
    why = np.where(between, np.float32(Reason.EDGE), np.float32(Reason.MIXED))
    return without(layers, lost, why)


def tof_floor(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds noise that does not depend on the light and is correlated between neighbours."""
    depth = layers["depth"]
    sigma = np.sqrt(floor_variance(view, layers, p, depth))
    return {"depth": moved_by_mm(depth, sigma * correlated_noise(view.window, view.seed))}


def floor_variance(view: FrameContext, layers: Layers, p: Parameters, depth_m: Image) -> Image:
    """Compute the variance of the noise that does not depend on the light, mm^2."""
    normal, rays = layers["normal"], layers["rays"]
    facing = normal[..., 0] * rays[..., 0] + normal[..., 1] * rays[..., 1] + normal[..., 2]
    aside = np.sqrt(normal[..., 0] * normal[..., 0] + normal[..., 1] * normal[..., 1])
    slope = np.minimum(aside / np.maximum(-facing, np.float32(1e-3)), _STEEPEST)
    focal = np.float32(view.focal_px)
    slanted = p["lateral_px"] * slope * np.float32(1000.0) * depth_m / focal
    variance: Image = p["sigma_mm"] * p["sigma_mm"] + slanted * slanted
    return variance


def _border(view: FrameContext) -> NDArray[np.bool_]:
    """Return a mask of the frame's outermost pixels, which the decoder does not filter."""
    x, y = pixels(view.window)
    border: NDArray[np.bool_] = (x == 0) | (x == view.width - 1) | (y == 0) | (y == view.height - 1)
    return border


def field_stop(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Removes depth and infrared outside the lens's field of view."""
    x, y = layers["rays"][..., 0], layers["rays"][..., 1]
    r2 = x * x + y * y
    lens = view.lens
    upper, lower = (
        _ONE + r2 * (np.float32(a) + r2 * (np.float32(b) + r2 * np.float32(c)))
        for a, b, c in ((lens.k1, lens.k2, lens.k3), (lens.k4, lens.k5, lens.k6))
    )
    across = np.abs(x * (upper / lower) - p["centre_x"])
    down = np.abs(y * (upper / lower) - p["centre_y"])
    out_by = np.maximum(down, _HALF_ROOT_3 * across + _HALF * down)
    lost = ((p["side"] > 0) & (out_by > p["side"])) | (r2 >= p["widest_tan"] * p["widest_tan"])
    known = layers["reason"] == Reason.NO_SURFACE
    why = np.where(known, layers["reason"], np.float32(Reason.LOW_SIGNAL))
    return {
        "depth": np.where(lost, _ZERO, layers["depth"]),
        "reason": np.where(lost, why, layers["reason"]),
        "infrared": np.where(lost, _ZERO, layers["infrared"]),
    }


def tof_fast(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Adds noise of known statistics on even surfaces; adds up phasors beside depth steps."""
    clean, lit = layers["clean"], layers["lit"]
    depths = [beside(view, clean, dx, dy, clamped=True) for dx, dy in square(1)]
    at_step = np.max(depths, axis=0) - np.min(depths, axis=0) > np.float32(0.001) * p["step_mm"]
    seen = phasors(view, p, clean, layers["normal"], layers["rays"], lit)
    mixed = np.zeros_like(seen)
    for dx, dy in square(1):
        mixed += _BLUR[abs(dx)] * _BLUR[abs(dy)] * beside(view, seen, dx, dy, clamped=True)
    mixed = np.where(at_step[..., None], mixed, seen)
    amplitude = mixed[..., 6]
    real, imaginary, marked = _filtered_fast(view, p, mixed, seen)
    m = CONTRAST_MULTIPLIER
    variance = p["read_variance"] + p["shot_variance"] * (amplitude[..., None] / m)
    sigma = np.sqrt(np.float32(2 / 3) * m * m * variance) / KERNEL_UNIT
    bits = [random_bits(*pixels(view.window), view.seed, 1 + k) for k in range(3)]
    noise = [normal_pair(first, second) for first, second, _, _ in bits]
    real += sigma * np.stack([pair[0] for pair in noise], axis=-1)
    imaginary += sigma * np.stack([pair[1] for pair in noise], axis=-1)
    dimmed = amplitude + sigma.max(axis=-1) * noise[0][0]
    kept = np.where(dimmed < np.float32(1.1) * p["min_amplitude"], _ZERO, _ONE)[..., None]
    real = np.where(at_step[..., None], real, kept * mixed[..., 0:6:2])
    imaginary = np.where(at_step[..., None], imaginary, kept * mixed[..., 1:6:2])
    z, reason, sums = decoded(view, layers, p, real, imaginary)
    reason = np.where((amplitude <= 0) & (clean <= 0), np.float32(Reason.NO_SURFACE), reason)
    reason = np.where(amplitude > p["saturation_lsb"], np.float32(Reason.SATURATED), reason)
    valid = (reason == Reason.VALID) | (reason == Reason.GROWN)
    turns = np.sqrt((sigma * sigma).sum(axis=-1)) / np.maximum(amplitude, _ONE) / TWO_PI
    light_mm = np.float32(1000.0) * turns * half_wave_m_mhz() / frequencies(view).sum()
    rays = layers["rays"]
    light_mm = light_mm / np.sqrt((rays * rays).sum(axis=-1) + _ONE)  # along z, not along the ray
    light_mm = np.where(at_step, _ZERO, light_mm)
    spread = np.sqrt(floor_variance(view, layers, p, z) + light_mm * light_mm)
    z = np.where(valid, z, _ZERO)
    depth = moved_by_mm(
        z, np.where(valid, spread, _ZERO) * correlated_noise(view.window, view.seed)
    )
    usable = np.where(at_step & marked, _ZERO, depth)
    return {
        "depth": depth,
        "reason": reason,
        "infrared": np.minimum(np.float32(16.0) * amplitude, np.float32(65535.0)),
        "decoded": np.stack([usable, sums], axis=-1),
        **expected_depth(view, p, layers),
    }


def _filtered_fast(
    view: FrameContext, p: Parameters, mixed: Image, seen: Image
) -> tuple[Image, Image, NDArray[np.bool_]]:
    """Filter phasors by a 3x3 bilateral filter; return real part, imaginary part and edge mask."""
    real, imaginary = mixed[..., 0:6:2], mixed[..., 1:6:2]
    unit = _ONE / np.sqrt(np.maximum(real * real + imaginary * imaginary, _TINY))
    bright = mixed[..., 6:] >= p["min_amplitude"]
    total, apart = np.full_like(real, KERNEL[0]), np.zeros_like(real)
    sum_real, sum_imaginary = KERNEL[0] * real, KERNEL[0] * imaginary
    for dx, dy in (offset for offset in square(1) if offset != (0, 0)):
        part = beside(view, seen, dx, dy, clamped=True)
        light = part[..., 6:]
        pure = part[..., :6] / np.where(light > 0, light, _ONE)
        r, i = pure[..., 0::2], pure[..., 1::2]
        away = _HALF - _HALF * (real * r + imaginary * i) * unit
        counts = np.where((light >= p["min_amplitude"]) | ~bright, _ONE, _ZERO)
        falls = np.where(bright, np.exp(-_LOG2_E * p["sharpness"] * away), _ONE)
        weight = counts * KERNEL[abs(dx) + abs(dy)] * falls
        apart += counts * away
        sum_real += weight * light * r
        sum_imaginary += weight * light * i
        total += weight
    return sum_real / total, sum_imaginary / total, apart.max(axis=-1) >= p["max_edge"]
