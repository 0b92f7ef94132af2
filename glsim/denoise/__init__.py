"""Denoisers of depth maps: classical filters, trained networks, and your own functions.

    from glsim.denoise import load_denoiser
    depth_mm, valid = load_denoiser("face")(noisy_mm)

noisy_mm: (H, W), float or uint16 millimetres, 0 = no return. ``load`` gives the same denoiser as a
``Method``, which also takes sequences of frames.
"""

from glsim.denoise.protocol import (
    COMPOSITES,
    Denoised,
    Denoiser,
    Method,
    SequenceDenoiser,
    compose,
)
from glsim.denoise.registry import (
    GRIDS,
    PAPER_FILTERS,
    SHIPPED,
    denoiser_names,
    describe_denoiser,
    load,
    load_denoiser,
)

__all__ = [
    "COMPOSITES",
    "GRIDS",
    "PAPER_FILTERS",
    "SHIPPED",
    "Denoised",
    "Denoiser",
    "Method",
    "SequenceDenoiser",
    "compose",
    "denoiser_names",
    "describe_denoiser",
    "load",
    "load_denoiser",
]
