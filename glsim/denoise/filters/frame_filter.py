"""The base class of filters of single frames."""

from __future__ import annotations

from abc import abstractmethod

from glsim.core.array_types import Depth, Mask
from glsim.networks.interface import Denoised, DepthFunction


class FrameFilter(DepthFunction):
    """A filter of single depth frames, which sees neither neighbours in time nor infrared."""

    def __call__(
        self, noisy_mm: Depth, valid: Mask, now: int, infrared: Depth | None = None
    ) -> Denoised:
        """Filter frame ``now`` of a sequence."""
        return self.filtered(noisy_mm[now], valid[now])

    @abstractmethod
    def filtered(self, noisy_mm: Depth, valid: Mask) -> Denoised:
        """Filter an (H, W) frame, mm, with the (H, W) bool mask of its returns."""
