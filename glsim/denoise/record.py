"""What the file of a network records about its training, besides its weights and inputs."""

from __future__ import annotations

from typing import Final, NamedTuple

from glsim.denoise.composites import UNLIKELY
from glsim.denoise.tiles import AROUND_PX
from glsim.depth_protocol import DepthProtocol


class NetworkRecord(NamedTuple):
    """How denoisers run a network, as its training left it. Older files have the defaults.

    Attributes:
        protocol: where the depths of its training are counted from.
        keep_clean: whether frames without noise are returned unchanged: those whose noise rounding
            and the form of surfaces explain (``glsim.denoise.safeguards``).
        margin_px: holes around depth that the network still sees, px.
        unlikely: pixels beside holes are dropped if their probability of depth is at most this, by
            the composite "measured" (``glsim.denoise.composites.UNLIKELY``).
    """

    protocol: DepthProtocol = "depth"
    keep_clean: bool = True
    margin_px: int = AROUND_PX
    unlikely: float = UNLIKELY


#: The record of a file without one.
DEFAULT_RECORD: Final = NetworkRecord()
