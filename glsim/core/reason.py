"""Reason codes: why each pixel of the noisy depth map is valid, altered or missing.

The codes are the pixel values of ``*_reason.png``. Shaders see the same names
(REASON_SHADOW, ...) through ``#include "reason.glsl"``, which is generated from this enumeration.
"""

from __future__ import annotations

from enum import IntEnum


class Reason(IntEnum):
    """The uint8 reason code of a pixel; only VALID, MOVED and GROWN pixels have depth."""

    VALID = 0
    NO_SURFACE = 1
    SHADOW = 2
    OUT_OF_RANGE = 3
    LOW_SIGNAL = 4
    EDGE = 5
    DROPPED = 6
    WINDOW = 7
    MOVED = 8
    GROWN = 9
    SATURATED = 10
    UNWRAP = 11
    MIXED = 12

    @property
    def help(self) -> str:
        """The meaning of the code in one line."""
        return _HELP[self]

    @property
    def has_depth(self) -> bool:
        """Whether a pixel with this code has depth."""
        return self in (Reason.VALID, Reason.MOVED, Reason.GROWN)


_HELP = {
    Reason.VALID: "measured (with noise)",
    Reason.NO_SURFACE: "nothing there within the clip planes",
    Reason.SHADOW: "seen by the camera, not lit by the emitter, or not seen by the second imager "
    "or by the depth camera whose frame is registered",
    Reason.OUT_OF_RANGE: "nearer or farther than the sensor's measuring range",
    Reason.LOW_SIGNAL: "too little infrared came back",
    Reason.EDGE: "removed at a depth edge",
    Reason.DROPPED: "lost at random, or zeroed by a stage that gave no reason",
    Reason.WINDOW: "the correlation window found no match",
    Reason.MOVED: "carries the depth of another surface across an edge",
    Reason.GROWN: "carries a depth though the clean map has no surface there",
    Reason.SATURATED: "too much infrared came back",
    Reason.UNWRAP: "the phases of the frequencies disagree",
    Reason.MIXED: "rejected as a mixture of two surfaces",
}


def glsl() -> str:
    """Return the text of the generated GLSL include "reason.glsl"."""
    lines = [f"const float REASON_{r.name} = {r.value}.0; // {r.help}" for r in Reason]
    return "\n".join(["// generated from glsim/core/reason.py", *lines]) + "\n"
