"""Denoisers of depth maps: classical filters, trained networks, and functions of the user.

    from glsim.denoise import load_denoiser
    depth_mm, valid = load_denoiser("face")(noisy_mm)

noisy_mm: (H, W), float or uint16 millimetres, 0 = no return. ``Denoiser.push`` takes the frames of
a camera one by one; ``Denoiser.estimate`` takes sequences of frames and gives a network's
probability of depth and standard deviation.
"""

from glsim.denoise.composites import COMPOSITES, DEFAULT_COMPOSITE, check_composite
from glsim.denoise.denoiser import Denoiser, Estimate
from glsim.denoise.interface import Denoised, DepthFunction
from glsim.denoise.registry import (
    GRIDS,
    PAPER_FILTERS,
    SHIPPED,
    denoiser_names,
    describe_denoiser,
    load_denoiser,
)

__all__ = [
    "COMPOSITES",
    "DEFAULT_COMPOSITE",
    "GRIDS",
    "PAPER_FILTERS",
    "SHIPPED",
    "Denoised",
    "Denoiser",
    "DepthFunction",
    "Estimate",
    "check_composite",
    "denoiser_names",
    "describe_denoiser",
    "load_denoiser",
]
