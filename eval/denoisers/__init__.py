"""Denoisers by name: ``(noisy_mm, valid) -> (depth_mm, valid)``. ``load`` reads their names."""

from .base import COMPOSITES, Denoised, Denoiser, Method, SequenceDenoiser, compose
from .registry import GRIDS, PAPER, describe, known, load

__all__ = [
    "COMPOSITES",
    "GRIDS",
    "PAPER",
    "Denoised",
    "Denoiser",
    "Method",
    "SequenceDenoiser",
    "compose",
    "describe",
    "known",
    "load",
]
