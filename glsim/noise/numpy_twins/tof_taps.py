"""Twin of tof_taps, and the taps themselves, which the GPU does not store."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.noise.frame_context import Layers, StageView
from glsim.noise.numpy_twins.layers import Image, Parameters, pixels
from glsim.noise.numpy_twins.random import normal_pair, random_bits
from glsim.noise.numpy_twins.tof_turns import TWO_PI, frequencies, half_wave_m_mhz

#: libfreenect2's ab_multiplier_per_frq, and the phases of the taps.
CONTRAST_MULTIPLIER = np.array([1.322581, 1.0, 1.612903], np.float32)
TAP_COS = np.array([1.0, -0.5, -0.5], np.float32)
TAP_SIN = np.array([0.0, 0.86602540378, -0.86602540378], np.float32)
#: The largest value of the 11-bit code (libfreenect2's lookup table).
LARGEST_TAP = np.float32(16320.0)
_COUNTS_PER_AMPLITUDE = np.float32(16.0)
_LIMIT = np.float32(65535.0)
#: The halo: weights per axis within 3x3, of the four pixels at a distance of 2; the haze's reach.
_HALO = {0: np.float32(0.332485), 1: np.float32(0.234939)}
_HALO_OUTER = np.float32(0.0891)
_REACH_PX = 4


def companded(taps: Image) -> Image:
    """Round taps to the values of the 11-bit code."""
    size = np.minimum(np.abs(taps), LARGEST_TAP)
    exponent = np.frexp(size)[1] - 1
    step = np.ldexp(np.float32(1.0), np.maximum(exponent - 7, 0)).astype(np.float32)
    rounded = np.minimum(np.floor(size / step + np.float32(0.5)) * step, LARGEST_TAP)
    result: Image = np.sign(taps) * rounded
    return result


def taps_of(
    view: StageView, layers: Layers, p: Parameters
) -> tuple[Image, NDArray[np.bool_], NDArray[np.bool_]]:
    """(h, w, 3, 3) taps by frequency and phase, and (h, w) masks of read and saturated pixels."""
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
    read: NDArray[np.bool_] = seen & ~border
    return taps, read, np.asarray(saturated)


def demodulated(taps: Image) -> tuple[Image, Image]:
    """(..., 3) real and imaginary parts, in units of amplitude, from (..., 3, 3) taps."""
    scale = CONTRAST_MULTIPLIER * np.float32(2.0) / np.float32(3.0)
    return scale * (taps * TAP_COS).sum(axis=-1), -scale * (taps * TAP_SIN).sum(axis=-1)


def tof_taps(view: StageView, layers: Layers, p: Parameters) -> dict[str, Image]:
    """Measures taps with noise, and combines them into one phasor per frequency."""
    taps, read, saturated = taps_of(view, layers, p)
    real, imaginary = demodulated(taps)
    amplitude = np.sqrt(real * real + imaginary * imaginary)
    mean = (amplitude[..., 0] + amplitude[..., 1] + amplitude[..., 2]) / np.float32(3.0)
    infrared = np.where(saturated, _LIMIT, np.minimum(_COUNTS_PER_AMPLITUDE * mean, _LIMIT))
    both = np.stack([real, imaginary], axis=-1).reshape(*read.shape, 6)
    both = np.where((read & ~saturated)[..., None], both, np.float32(0.0))
    counts = np.where(read, infrared, np.float32(0.0))
    flags = np.where(read & saturated, np.float32(2.0), np.float32(0.0))
    b = np.concatenate([both[..., 4:], counts[..., None], flags[..., None]], axis=-1)
    return {"phasor_a": both[..., :4], "phasor_b": b}


def _blurred(view: StageView, light: Image, p: Parameters) -> tuple[Image, NDArray[np.bool_]]:
    """Light after the optics, and whether a pixel or one of its 8 neighbours has light.

    0 outside the window, clamped at the frame.
    """
    one = np.float32(1.0)
    side = np.float32(0.5) * p["psf_sigma_px"] * p["psf_sigma_px"]
    weight = {0: one - np.float32(2.0) * side, 1: side}
    core = one - p["halo"] - p["haze"]
    left, top, width, height = view.window
    x = np.clip(np.arange(left - _REACH_PX, left + width + _REACH_PX), 0, view.width - 1) - left
    y = np.clip(np.arange(top - _REACH_PX, top + height + _REACH_PX), 0, view.height - 1) - top
    padded = light[np.clip(y, 0, height - 1)][:, np.clip(x, 0, width - 1)]
    padded[(y < 0) | (y >= height)] = 0.0
    padded[:, (x < 0) | (x >= width)] = 0.0

    def beside(dx: int, dy: int) -> Image:
        row, column = _REACH_PX + dy, _REACH_PX + dx
        part: Image = padded[row : row + height, column : column + width]
        return part

    total, late, haze = np.zeros_like(light), np.zeros_like(light), np.zeros_like(light)
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            total += core * weight[abs(dx)] * weight[abs(dy)] * beside(dx, dy)
            late += p["halo"] * _HALO[abs(dx)] * _HALO[abs(dy)] * beside(dx, dy)
    beside_light = total[..., 6] + late[..., 6] > 0
    for dx, dy in ((-2, 0), (2, 0), (0, -2), (0, 2)):
        late += _HALO_OUTER * p["halo"] * beside(dx, dy)
    for dx, dy in ((-4, -4), (4, -4), (-4, 4), (4, 4)):
        haze += np.float32(0.25) * p["haze"] * beside(dx, dy)
    later = TWO_PI * np.float32(0.001) * p["halo_delay_mm"] * frequencies(view) / half_wave_m_mhz()
    late = _turned(late, np.cos(later), np.sin(later))
    real, imaginary = core + p["halo"] * np.cos(later), p["halo"] * np.sin(later)
    size = np.sqrt(real * real + imaginary * imaginary)
    return _turned(total + late, real / size, -imaginary / size) + haze, beside_light


def _turned(light: Image, c: Image, s: Image) -> Image:
    """Turn the phasors of (h, w, 8) light by angles, given as cosines and sines per frequency."""
    turned = light.copy()
    real, imaginary = light[..., 0:6:2], light[..., 1:6:2]
    turned[..., 0:6:2] = real * c - imaginary * s
    turned[..., 1:6:2] = real * s + imaginary * c
    return turned
