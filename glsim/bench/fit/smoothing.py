"""Fit of the smoothing filter that explains a camera's correlated noise, for time of flight.

The Kinect V2's decoder averages phasors over 3 x 3 pixels: its noise is uncorrelated beyond 2 px.
Noise with longer correlation needs the chain's other filter, ``tof_smooth``, a Gaussian over 7 x 7.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from glsim.bench.fit.noise_model import FILTER_GAIN, TapNoise
from glsim.core.array_types import Array
from glsim.measures.correlation import LAGS

#: Radius of ``tof_smooth``, px, and standard deviations of its Gaussian that are tried, px.
_REACH_PX = 3
_WIDTHS_PX = np.linspace(0.6, 10.0, 189)
#: Correlation at LAGS after a mean of 3 x 3 pixels, which the narrow filter is on a smooth surface.
_NARROW = np.array([max(3 - abs(down), 0) * max(3 - abs(right), 0) / 9.0 for down, right in LAGS])
#: If the correlation differs from the narrow filter's (white noise added) by at most this rms, no
#: other filter is needed. Chosen: simulated Kinect V2s differ by 0.02.
_MOST_MISFIT = 0.05
#: The stages that filter in the two processing chains.
NARROW, WIDE = "tof_bilateral", "tof_smooth"


@dataclass(frozen=True)
class Smoothing:
    """A Gaussian filter over 7 x 7 pixels, followed by white noise.

    Attributes:
        width_px: standard deviation of the Gaussian.
        share: share of the variance that is filtered noise; the rest is white noise.
        correlation: correlation of the total noise at LAGS.
    """

    width_px: float
    share: float
    correlation: tuple[float, ...]


def find_smoothing(correlation: Sequence[float]) -> Smoothing | None:
    """Find the filter that explains the correlation of the temporal noise at LAGS.

    Returns None if the Kinect V2's own filter explains it, or if a correlation is unknown.
    """
    target = np.array(correlation[: len(LAGS)])
    if not np.isfinite(target).all():
        return None
    if _misfit(_NARROW, target)[1] <= _MOST_MISFIT:
        return None
    best, least = None, np.inf
    for width in _WIDTHS_PX:
        filtered = _correlation(float(width))
        share, misfit = _misfit(filtered, target)
        if misfit < least:
            best, least = Smoothing(float(width), share, tuple(share * filtered)), misfit
    return best


def _misfit(filtered: Array, target: Array) -> tuple[float, float]:
    """Fit the share of filtered noise (the rest is white); return it and the residual's rms."""
    share = float(np.clip((filtered @ target) / (filtered @ filtered), 0.0, 1.0))
    return share, float(np.sqrt(((share * filtered - target) ** 2).mean()))


def smoothed_values(
    values: Mapping[str, float], smoothing: Smoothing, base: TapNoise, sigma_mm: float
) -> dict[str, float]:
    """Adapt fitted parameters to a processing chain with a wider smoothing filter.

    A wider filter removes more noise. The noise of the taps is raised, so that the filter's output
    has the same noise as before. 1 - ``smoothing.share`` of the variance is white noise after the
    filter; it becomes the floor.

    Args:
        values: fitted parameters for the narrow filter.
        base: noise of the base sensor's taps.
        sigma_mm: typical temporal noise of a pixel.
    """
    gain = 1.0 / np.sqrt((_kernel(smoothing.width_px) ** 2).sum())
    floor = min(values["sigma_mm"], float(np.sqrt(1.0 - smoothing.share)) * sigma_mm)
    behind = max(sigma_mm**2 - values["sigma_mm"] ** 2, 0.1 * sigma_mm**2)
    factor = (sigma_mm**2 - floor**2) / behind * float(gain / FILTER_GAIN) ** 2
    taps = {name: factor * values.get(name, old) for name, old in base._asdict().items()}
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
