"""NumPy twins of the stages that draw infrared images: dots, light and exposure of the imagers."""

from __future__ import annotations

import numpy as np

from glsim.core.arrays import Words
from glsim.core.camera import Point
from glsim.noise.frame_context import FrameContext
from glsim.noise.layer_names import PROJECTOR_LAYER
from glsim.noise.twins.layers import (
    Image,
    Layers,
    Parameters,
    around,
    mix,
    normal_pair,
    pcg_word,
    pixels,
    random_bits,
    square,
    uniform01,
)


def stereo_light(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Draw the light that reaches two imagers, with the dots of up to two projectors."""
    left, right = (
        _imaged_light(view, layers, p, side, imager)
        for side, imager in zip(("left", "right"), view.imagers_m, strict=True)
    )
    return {"light_left": left, "light_right": right}


def pattern_light(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Draw the light that reaches one imager, and the pattern that it is matched with."""
    left = _imaged_light(view, layers, p, "left", view.imagers_m[0])
    pattern = _thrown(view, layers, layers["rays"], _key(view), p)
    return {"light_left": left, "light_right": np.maximum(pattern, np.float32(0))}


def stereo_exposure(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Simulate two infrared images, counts, from the light that reaches the imagers."""
    noise, gain = _noise_and_gain(view)
    left, right = (_blurred(view, layers[n], p) for n in ("light_left", "light_right"))
    return {
        "infrared": _counts(view, left, noise[0], gain[0], p),
        "infrared_right": _counts(view, right, noise[1], gain[1], p),
    }


def pattern_exposure(view: FrameContext, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Simulate one infrared image, counts, and the equally blurred image of the pattern."""
    noise, gain = _noise_and_gain(view)
    left = _blurred(view, layers["light_left"], p)
    level = p["reference_counts"] * _blurred(view, layers["light_right"], p)
    return {"infrared": _counts(view, left, noise[0], gain[0], p), "reference": _whole(level, p)}


def _key(view: FrameContext) -> Words:
    return pcg_word(np.array([view.device_seed], np.uint32))


def dots(tangent: Image, key: Words, p: Parameters) -> Image:
    """Compute the brightness of the dot pattern in directions (..., 2), x/z and y/z."""
    half = np.float32(0.5)
    place = tangent / (np.float32(0.001) * p["dot_spacing_mrad"])
    first = np.floor(place - half).astype(np.int64)
    ratio = p["dot_spacing_mrad"] / p["dot_sigma_mrad"]
    narrowness = -half * ratio * ratio
    total = np.zeros(tangent.shape[:-1], np.float32)
    for y in (0, 1):
        for x in (0, 1):
            cell = first + np.array([x, y])
            row = pcg_word(cell[..., 1].astype(np.uint32) + key)
            word = pcg_word(cell[..., 0].astype(np.uint32) + row)
            drawn = np.stack([word & 2047, (word >> 11) & 2047], axis=-1).astype(np.float32)
            drawn = drawn / np.float32(2047) - half
            centre = cell.astype(np.float32) + half + p["dot_disorder"] * drawn
            offset = place - centre
            spread = np.float32(2) * (word >> 22).astype(np.float32) / np.float32(1023)
            bright = np.float32(1) + p["dot_variation"] * (spread - np.float32(1))
            total += bright * np.exp(np.maximum(narrowness * (offset * offset).sum(-1), _LEAST))
    return total


#: Exponents below this give 0 in float32; NumPy would warn of an underflow.
_LEAST = np.float32(-80)


def _thrown(view: FrameContext, layers: Layers, tangent: Image, key: Words, p: Parameters) -> Image:
    """Compute a projector's brightness in directions (..., 2); -1 outside its field of view."""
    if PROJECTOR_LAYER not in layers:
        return dots(tangent, key, p)
    image, half = layers[PROJECTOR_LAYER], np.float32(0.5)
    size = np.array(image.shape[::-1], np.int64)
    view_tan = np.array(view.projector_tan, np.float32)
    place = (half * tangent / view_tan + half) * size.astype(np.float32)
    inside = ((place >= 0) & (place <= size)).all(axis=-1)
    corner = np.floor(place - half)
    part = place - half - corner
    first = np.clip(corner.astype(np.int64), 0, size - 1)
    last = np.clip(corner.astype(np.int64) + 1, 0, size - 1)
    upper, lower = (
        mix(image[row, first[..., 0]], image[row, last[..., 0]], part[..., 0])
        for row in (first[..., 1], last[..., 1])
    )
    return np.where(inside, mix(upper, lower, part[..., 1]), np.float32(-1))


def _imaged_light(
    view: FrameContext, layers: Layers, p: Parameters, side: str, imager: Point
) -> Image:
    depth, shape = layers[f"{side}_clean"], layers[f"{side}_normal"]
    lit = layers[f"{side}_lit"]
    seen = depth > 0
    z = np.where(seen, depth, np.float32(1))[..., None]
    point = np.concatenate([layers["rays"] * z, z], axis=-1) + np.array(imager, np.float32)
    key = _key(view)
    light = np.zeros_like(depth)
    for number, emitter in enumerate(view.emitters_m):
        word = key + np.uint32(number)
        way = point - np.array(emitter, np.float32)
        squared = (way * way).sum(-1)
        inverse = np.float32(1) / np.sqrt(squared)
        facing = np.maximum(-(shape[..., :3] * way).sum(-1) * inverse, np.float32(0))
        brightness = _thrown(view, layers, way[..., :2] / way[..., 2:], word, p)
        pattern = p["flood"] + (np.float32(1) - p["flood"]) * brightness
        pattern[brightness < 0] = 0
        thrown: Image = lit[..., number] * facing / squared * pattern
        light += thrown * (way[..., 2] * inverse) ** p["fall_off_power"]
    sky = np.float32(0.6) - np.float32(0.4) * shape[..., 1]
    albedo = shape[..., 3]
    day = p["daylight"] * p["daylight_counts"]
    share = np.maximum(p["texture_share"], p["daylight_texture"] if day > 0 else np.float32(0))
    if share > 0:
        albedo = albedo * (np.float32(1) + share * _grain(view, point, p))
    if day > 0:
        size, upright = p["dot_sigma_mrad"] / p["dot_spacing_mrad"], np.float32(0.6)
        dots = p["flood"] + (1 - p["flood"]) * np.float32(2 * np.pi) * size * size
        usual = p["gain_counts"] * dots + upright * p["ambient_counts"]
        longer = np.minimum(np.float32(view.subject_m * view.subject_m), np.float32(4))
        shorter = usual / (usual + longer * upright * day)
        albedo = albedo * np.maximum(shorter, p["shortest_exposure"] / longer)
    light = albedo * (p["gain_counts"] * light + (p["ambient_counts"] + day) * sky)
    return np.where(seen, light, np.float32(0))


def _grain(view: FrameContext, point: Image, p: Parameters) -> Image:
    far = np.maximum(np.float32(2) * point[..., 2:], np.float32(1))
    place = point * np.float32(1000) / (p["texture_mm"] * np.exp2(np.floor(np.log2(far))))
    cell = np.floor(place).astype(np.int64)
    part = place - cell.astype(np.float32)
    total = np.zeros(point.shape[:-1], np.float32)
    for corner in range(8):
        at = np.array([corner & 1, (corner >> 1) & 1, corner >> 2])
        x, y, z = np.moveaxis((cell + at).astype(np.uint32), -1, 0)
        word = pcg_word(x + pcg_word(y + pcg_word(z + np.uint32(view.sequence_seed))))
        near = np.where(at == 1, part, np.float32(1) - part).prod(axis=-1, dtype=np.float32)
        total += near * (np.float32(2) * uniform01(word) - np.float32(1))
    return total


def _noise_and_gain(view: FrameContext) -> tuple[tuple[Image, Image], tuple[Image, Image]]:
    """Sample the noise and the pixel gains of both images, each (h, w) standard normal numbers."""
    first, second, _, _ = random_bits(*pixels(view.window), view.seed, 0)
    noise = normal_pair(first, second)
    first, second, _, _ = random_bits(*pixels(view.window), view.device_seed, 1)
    return noise, normal_pair(first, second)


def _blurred(view: FrameContext, light: Image, p: Parameters) -> Image:
    psf = p["psf_sigma_px"]
    one = np.float32(1)
    side = np.exp(np.float32(-0.5) / (psf * psf)) if psf > 0 else np.float32(0)
    total, there = np.zeros_like(light), around(view, light, 1)
    for dx, dy in square(1):
        weight = (side if dx else one) * (side if dy else one)
        total += weight * there(dx, dy)
    whole = one + np.float32(2) * side
    return total / (whole * whole)


def _counts(view: FrameContext, light: Image, noise: Image, gain: Image, p: Parameters) -> Image:
    subject = np.float32(view.subject_m)
    factor = p["exposure"]
    if p["longest_exposure"] > 0:
        factor = factor * np.minimum(subject * subject, p["longest_exposure"])
    signal = factor * light * (np.float32(1) + p["pixel_gain_sigma"] * gain)
    speckle = p["speckle_sigma"] * signal
    read = p["read_sigma_counts"] * p["read_sigma_counts"]
    sigma = np.sqrt(p["shot_counts"] * signal + read + speckle * speckle)
    return _whole(signal + sigma * noise, p)


def _whole(counts: Image, p: Parameters) -> Image:
    largest = np.exp2(p["bits"]) - np.float32(1)
    clipped: Image = np.clip(np.floor(counts + np.float32(0.5)), np.float32(0), largest)
    return clipped
