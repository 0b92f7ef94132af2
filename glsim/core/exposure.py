"""When the parts of a frame are exposed: captures of a time-of-flight camera, or bands of rows.

A frame's instant is the middle of its exposure. Whoever simulates motion draws the scene at the
time of each part; glsim.render.sub_frames puts the parts together.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

#: Captures of a time-of-flight frame that measure: three taps of each of three frequencies.
TAPS, FREQUENCIES = 3, 3


@dataclass(frozen=True)
class SubExposure:
    """A part of a frame that is exposed at one time.

    Attributes:
        time_ms: of its middle, from the frame's instant.
        capture: number of the capture, 0 to 8: tap capture % 3 of frequency capture // 3; None for
            rows.
        rows: (first, end) of the band as shares of the image's height; None for a capture.
    """

    time_ms: float
    capture: int | None = None
    rows: tuple[float, float] | None = None


@dataclass(frozen=True)
class Exposure:
    """When the parts of a frame are exposed; by default all at once.

    Args:
        captures: of a time-of-flight frame, one after the other; 0: another camera. The first nine
            measure, frequency by frequency in the rig's order; a tenth is not used.
        spacing_ms: from one capture to the next.
        read_out_ms: of a rolling shutter, from the first row to the last; 0: a global one.
        bands: of rows that share one time.
    """

    captures: int = 0
    spacing_ms: float = 0.0
    read_out_ms: float = 0.0
    bands: int = 16

    def parts(self) -> tuple[SubExposure, ...]:
        """Return the parts of the exposure, earliest first; none if all pixels share one time."""
        if self.captures and self.spacing_ms > 0:
            middle = 0.5 * (self.captures - 1)
            return tuple(
                SubExposure((k - middle) * self.spacing_ms, capture=k)
                for k in range(TAPS * FREQUENCIES)
            )
        if self.read_out_ms > 0:
            shares = [k / self.bands for k in range(self.bands + 1)]
            return tuple(
                SubExposure((0.5 * (a + b) - 0.5) * self.read_out_ms, rows=(a, b))
                for a, b in pairwise(shares)
            )
        return ()
