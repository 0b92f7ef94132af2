"""Denoisers by name: ``(noisy_mm, valid) -> (depth_mm, valid)``. ``load`` reads their names."""

from .base import COMPOSITES, Denoised, Denoiser, Method, SequenceDenoiser, compose
from .registry import GRIDS, PAPER, SHIPPED, describe, known, load

__all__ = [
    "COMPOSITES",
    "GRIDS",
    "PAPER",
    "SHIPPED",
    "Denoised",
    "Denoiser",
    "Method",
    "SequenceDenoiser",
    "compose",
    "describe",
    "known",
    "load",
]
