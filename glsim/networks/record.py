"""Settings of a denoiser that are chosen in training and stored in each file of its network."""

from __future__ import annotations

from typing import Final, NamedTuple

from glsim.core.depth_protocol import DepthProtocol

#: Holes around depth that a network still sees, px. Measured: with 48 px the shipped networks give
#: the depth of the whole frame to 0.004 mm, and probabilities to 1e-4; with 32 px to 0.1 mm.
#: face-stereo, of five scales, needs 80 px (0.002 mm; with 48 px it chooses other surfaces).
AROUND_PX: Final = 48


class NetworkRecord(NamedTuple):
    """Settings of a network's denoiser, chosen in training; a file without them has the defaults.

    Attributes:
        protocol: depth protocol of its training.
        keep_clean: whether frames are returned unchanged that ``clean_noise_mm`` finds clean.
        margin_px: holes around depth that the network still sees, px.
    """

    protocol: DepthProtocol = "depth"
    keep_clean: bool = True
    margin_px: int = AROUND_PX


#: The record of a file that has no record.
DEFAULT_RECORD: Final = NetworkRecord()
