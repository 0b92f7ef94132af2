"""Block matching and collaborative filtering (BM3D), by the package ``bm3d``.

K. Dabov et al., "Image Denoising by Sparse 3-D Transform-Domain Collaborative Filtering", IEEE
Trans. Image Processing 16 (2007); for correlated noise: Y. Mäkinen, L. Azzari, A. Foi, ibid. 29
(2020). The authors' package is free for non-commercial use only. It is not part of glsim; only the
extra ``bm3d`` installs it.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from typing import Final

import numpy as np

from glsim.core.array_types import Array, Depth, Mask
from glsim.core.errors import require_package
from glsim.denoise.filters.masked import Masked
from glsim.denoise.filters.windows import fill
from glsim.denoise.parameters import parameter
from glsim.networks.safeguards import estimate_noise_mm, noise_share

#: Noise of frames with too little surface for an estimate; smallest noise, mm. Chosen.
_USUAL_MM, _LEAST_MM = 2.0, 0.01
#: Smallest side of an image for the package, px; it must be larger than its blocks and steps.
_LEAST_PX: Final = 32
#: Threshold of the first stage and weight of the second: the package's values for white noise.
#: ``strength`` scales both. For correlated noise the package fails under NumPy 2.4 (numpy.trapz).
_THRESHOLD, _WIENER = 3.0, 0.4
#: Depth is scaled so that its noise has this standard deviation. Chosen: the package's thresholds
#: for similar blocks are made for 20 grey levels of an 8-bit photograph, scaled to [0, 1].
_LEVEL: Final = 20 / 255
#: Share of white noise in the assumed variance. Chosen: without it, the package treats a Kinect
#: V2's differences between rows as form and keeps them.
_WHITE: Final = 0.03


@dataclass(frozen=True)
class BlockMatching(Masked):
    """BM3D (Dabov et al. 2007) for noise of a given correlation; needs the package bm3d."""

    correlation_px: float = parameter(
        0.7, 0.0, 10, "standard deviation of the Gaussian that correlates the noise, px; 0: white"
    )
    strength: float = parameter(1.0, 0.1, 10, "factor on the noise as estimated from the frame")

    def __post_init__(self) -> None:
        require_package("bm3d", "the denoiser bm3d", "bm3d")

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Compute smoothed depths; holes get the nearest depth first, to keep edges off 0."""
        import bm3d

        spectrum = noise_spectrum(self.correlation_px)
        seen_mm = estimate_noise_mm(np.where(support, noisy_mm, np.float32(0))) or _USUAL_MM
        sigma_mm = max(self.strength * seen_mm / noise_share(spectrum), _LEAST_MM)
        centre = np.float32(np.median(noisy_mm[support]))
        scale = sigma_mm / _LEVEL
        image = (fill(noisy_mm, support).astype(np.float64) - centre) / scale
        height, width = image.shape
        below, right = max(0, _LEAST_PX - height), max(0, _LEAST_PX - width)
        image = np.pad(image, [(0, below), (0, right)], mode="edge")
        profile = bm3d.BM3DProfile()
        profile.lambda_thr3d, profile.mu2 = _THRESHOLD, _WIENER
        profile.num_threads = 1  # several threads sum in any order
        noise = noise_spectrum(self.correlation_px, image.shape) * (_LEVEL**2 * image.size)
        smooth = bm3d.bm3d(image, noise, profile)
        smooth = np.asarray(smooth, np.float32).reshape(image.shape)[:height, :width]
        return np.asarray(np.maximum(smooth[wanted] * np.float32(scale) + centre, np.float32(0)))


def noise_spectrum(correlation_px: float, shape: tuple[int, int] = (64, 64)) -> Array:
    """Compute the (H, W) power spectrum, of mean 1, of noise of variance 1, in FFT order."""
    # The noise is white noise blurred by a Gaussian, plus a share _WHITE of white noise.
    rows, columns = (np.fft.fftfreq(size) for size in shape)
    square = np.add.outer(rows**2, columns**2)
    correlated = np.exp(-square * (2 * np.pi * correlation_px) ** 2)
    correlated /= correlated.mean()
    return np.asarray((1 - _WHITE) * correlated + _WHITE)


FILTERS = {"bm3d": BlockMatching}
#: Values that tuning tries if the package is installed; it takes 0.7 s for 128 x 128 px.
GRIDS = (
    {"bm3d": {"correlation_px": (0.5, 0.65, 0.8), "strength": (1.5, 2.2, 3.2)}}
    if find_spec("bm3d") is not None
    else {}
)
