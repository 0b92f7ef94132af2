"""Fit of the smoothing filter that explains a camera's correlated noise, for time of flight.

The Kinect V2's decoder averages phasors over 3 x 3 pixels: beyond two pixels its noise is white.
Noise that reaches farther needs the chain's other filter, ``tof_smooth``, a Gaussian over 7 x 7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from glsim.bench.fit.noise_model import FILTER_GAIN, TapNoise
from glsim.core.array_types import Array
from glsim.measures.correlation import LAGS

#: Pixels that ``tof_smooth`` reaches, and the widths of its Gaussian that are tried, px.
_REACH_PX = 3
_WIDTHS_PX = np.linspace(0.6, 10.0, 189)
#: Correlation at LAGS of an even mean of 3 x 3 pixels: the narrow filter's on a smooth surface.
_NARROW = np.array([max(3 - abs(down), 0) * max(3 - abs(right), 0) / 9.0 for down, right in LAGS])
#: Largest rms difference from it (white noise may be added) that needs no other filter. Chosen:
#: simulated Kinect V2s have 0.02.
_MOST_MISFIT = 0.05
#: The filters of the two chains.
NARROW, WIDE = "tof_bilateral", "tof_smooth"


@dataclass(frozen=True)
class Smoothing:
    """A Gaussian filter over 7 x 7 pixels, followed by white noise.

    Attributes:
        width_px: standard deviation of the Gaussian.
        share: of the variance that passed the filter; the rest is white.
        correlation: at LAGS, of both together.
    """

    width_px: float
    share: float
    correlation: tuple[float, ...]


def find_smoothing(correlation: Sequence[float]) -> Smoothing | None:
    """Find the filter that explains the measured correlation of the noise.

    Args:
        correlation: of the noise in time at LAGS.

    Returns:
        The filter; None if the Kinect V2's own explains it, or nothing is known.
    """
    target = np.array(correlation[: len(LAGS)])
    if not np.isfinite(target).all():
        return None
    if _misfit(_NARROW, target)[1] <= _MOST_MISFIT:
        return None
    best, least = None, np.inf
    for width in _WIDTHS_PX:
        own = _correlation(float(width))
        share, misfit = _misfit(own, target)
        if misfit < least:
            best, least = Smoothing(float(width), share, tuple(share * own)), misfit
    return best


def _misfit(own: Array, target: Array) -> tuple[float, float]:
    """Fit the share of filtered noise (the rest is white); return it and the rms residual."""
    share = float(np.clip((own @ target) / (own @ own), 0.0, 1.0))
    return share, float(np.sqrt(((share * own - target) ** 2).mean()))


def smoothed_values(
    values: Mapping[str, float], smoothing: Smoothing, base: TapNoise, sigma_mm: float
) -> dict[str, float]:
    """Adapt fitted parameters to a processing chain with a wider smoothing filter.

    The noise of taps grows as the filter's gain does, so that as much is left behind it. White
    noise behind the filter is the floor: it gets the share that the correlation leaves.

    Args:
        values: fitted parameters for the narrow filter.
        smoothing: the filter.
        base: noise of the base sensor's taps.
        sigma_mm: usual noise in time of a pixel.
    """
    gain = 1.0 / np.sqrt((_kernel(smoothing.width_px) ** 2).sum())
    floor = min(values["sigma_mm"], float(np.sqrt(1.0 - smoothing.share)) * sigma_mm)
    behind = max(sigma_mm**2 - values["sigma_mm"] ** 2, 0.1 * sigma_mm**2)
    factor = (sigma_mm**2 - floor**2) / behind * float(gain / FILTER_GAIN) ** 2
    taps = {name: factor * values.get(name, own) for name, own in base._asdict().items()}
    return {**values, **taps, "sigma_mm": floor}


def _kernel(width_px: float) -> Array:
    side = np.exp(-0.5 * (np.arange(-_REACH_PX, _REACH_PX + 1) / width_px) ** 2)
    kernel = np.outer(side, side)
    return np.asarray(kernel / kernel.sum())


def _correlation(width_px: float) -> Array:
    """Compute the correlation at LAGS of white noise after the filter."""
    kernel = _kernel(width_px)
    size = len(kernel)
    products = [
        (kernel[: size - down, : size - right] * kernel[down:, right:]).sum()
        for down, right in LAGS
    ]
    return np.asarray(np.array(products) / (kernel**2).sum())
