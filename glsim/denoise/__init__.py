"""Denoisers of depth maps: classical filters, trained networks, and your own functions.

    from glsim.denoise import load_denoiser
    depth_mm, valid = load_denoiser("face")(noisy_mm)

noisy_mm: (H, W), float or uint16 millimetres, 0 = no return. ``load_denoiser("face").stream()``
takes the frames of a camera one by one; ``load`` gives the same denoiser as a ``Method``, which
takes sequences of frames and returns a network's probability of depth.
"""

from glsim.denoise.composites import (
    COMPOSITES,
    DEFAULT_COMPOSITE,
    check_composite,
    compose,
    composed,
)
from glsim.denoise.interface import Denoised, Denoiser, Method, SequenceDenoiser
from glsim.denoise.map_denoiser import DepthStream, MapDenoiser
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
    "DEFAULT_COMPOSITE",
    "GRIDS",
    "PAPER_FILTERS",
    "SHIPPED",
    "Denoised",
    "Denoiser",
    "DepthStream",
    "MapDenoiser",
    "Method",
    "SequenceDenoiser",
    "check_composite",
    "compose",
    "composed",
    "denoiser_names",
    "describe_denoiser",
    "load",
    "load_denoiser",
]
