"""The interface of denoising functions: their arrays, arguments and results."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, Final, NamedTuple

from glsim.core.array_types import Depth, Mask, Probability
from glsim.core.depth_protocol import DepthProtocol

#: Smallest depth that a depth camera measures, mm. Maps with smaller depths are in another unit.
MIN_MEASURED_MM: Final = 50.0
#: A map is in metres, not mm, if its median, or 90 % of its floats, are below this.
METRES_MM: Final = 10.0
#: Smallest depth that counts as depth, mm; smaller values become 0 in a 16-bit file in mm.
MIN_DEPTH_MM: Final = 0.5


class Denoised(NamedTuple):
    """An (H, W) depth map, mm, and its mask or probability of depth in [0, 1]."""

    depth_mm: Depth
    valid: Mask | Probability


class DepthFunction(ABC):
    """A denoising function: a filter, a network, or the user's own function.

    Attributes:
        before, after: numbers of earlier and of later frames that it uses.
        protocol: depth protocol of its training; None if it accepts both.
        keep_clean: whether it returns frames without noise unchanged.
    """

    before: int = 0
    after: int = 0
    infrared: bool = False
    uncertain: bool = False
    protocol: DepthProtocol | None = None
    keep_clean: bool = False

    @abstractmethod
    def __call__(
        self, noisy_mm: Depth, valid: Mask, now: int, infrared: Depth | None = None
    ) -> tuple[Any, ...]:
        """Denoise frame ``now`` of a sequence; the ends of a sequence have fewer neighbours.

        Args:
            noisy_mm: (T, H, W) float32 millimetres, 0 = no return.
            valid: (T, H, W) bool mask of returns.
            infrared: (H, W) float32 counts of the frame.

        Returns:
            (H, W) depth, mm, and its validity, a bool mask or a probability in [0, 1]; if
            ``uncertain``, also the standard deviation, mm.
        """
