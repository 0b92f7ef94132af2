"""A rectangular window of pixels."""

from __future__ import annotations

from typing import NamedTuple


class Rect(NamedTuple):
    """A window of an image, in pixels: columns [left, left+width), rows [top, top+height)."""

    left: int
    top: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """The slices of rows and columns that index an image."""
        return (slice(self.top, self.top + self.height), slice(self.left, self.left + self.width))

    def contains(self, other: Rect) -> bool:
        """Return whether ``other`` lies inside this window."""
        return (
            self.left <= other.left
            and self.top <= other.top
            and self.left + self.width >= other.left + other.width
            and self.top + self.height >= other.top + other.height
        )

    def intersection(self, other: Rect) -> Rect:
        """Return the window of common pixels; its size is 0 if there are none."""
        left, top = max(self.left, other.left), max(self.top, other.top)
        right = min(self.left + self.width, other.left + other.width)
        bottom = min(self.top + self.height, other.top + other.height)
        return Rect(left, top, max(0, right - left), max(0, bottom - top))
