"""One simulated frame, and how depth becomes whole numbers."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.camera import Intrinsics
from glsim.errors import ConfigError, did_you_mean
from glsim.faces.base import FaceKey
from glsim.reason import Reason

_T = TypeVar("_T", bound=np.generic)

#: The largest depth a 16-bit file can hold, in units.
_UINT16_MAX = 65535

#: The layers that every frame has: clean, noisy, infrared are uint16, reason is uint8.
LAYERS = ("clean", "noisy", "infrared", "reason")
#: Those that can be written to files; regions (uint8) is drawn only where it is asked for.
WRITABLE = (*LAYERS, "regions")


class Rect(NamedTuple):
    """A window of an image, pixels: columns [left, left+width), rows [top, top+height)."""

    left: int
    top: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Rows and columns, to index an image with."""
        return (
            slice(self.top, self.top + self.height),
            slice(self.left, self.left + self.width),
        )

    def contains(self, other: Rect) -> bool:
        """Whether ``other`` lies within."""
        return (
            self.left <= other.left
            and self.top <= other.top
            and self.left + self.width >= other.left + other.width
            and self.top + self.height >= other.top + other.height
        )

    def intersection(self, other: Rect) -> Rect:
        """What both cover; width or height 0 if nothing."""
        left, top = max(self.left, other.left), max(self.top, other.top)
        right = min(self.left + self.width, other.left + other.width)
        bottom = min(self.top + self.height, other.top + other.height)
        return Rect(left, top, max(0, right - left), max(0, bottom - top))


def encode_depth(depth_m: NDArray[np.floating], unit_mm: float = 1.0) -> NDArray[np.uint16]:
    """Depth in metres to whole units, rounded; 0 stays 0, and nothing else becomes 0.

    Raises ConfigError where a depth exceeds 65535 units.
    """
    units = np.rint(depth_m * np.float32(1000.0 / unit_mm))
    if units.max(initial=0.0) > _UINT16_MAX:
        raise ConfigError(
            f"a depth of {units.max() * unit_mm:.0f} mm does not fit 16 bits in units of "
            f"{unit_mm} mm: choose a larger --depth-unit-mm"
        )
    np.maximum(units, 1.0, out=units, where=depth_m > 0)
    encoded: NDArray[np.uint16] = units.astype(np.uint16)
    return encoded


def decode_depth(units: NDArray[np.uint16], unit_mm: float = 1.0) -> NDArray[np.float32]:
    """The inverse of ``encode_depth``: float32 metres, 0 = no return."""
    return units.astype(np.float32) * np.float32(unit_mm / 1000.0)


def to_mm(units: NDArray[Any], unit_mm: float, offset_mm: float) -> NDArray[np.float32]:
    """float32 millimetres of the units of a depth file, and what was subtracted; 0 stays 0."""
    depth_mm: NDArray[np.float32] = units * np.float32(unit_mm)
    if offset_mm:
        np.add(depth_mm, np.float32(offset_mm), out=depth_mm, where=units > 0)
    return depth_mm


@dataclass(frozen=True, eq=False)
class Frame:
    """A clean and a noisy depth map of one face, with how they came about.

    Images are kept as the window that holds anything; ``depth_m``, ``clean``, ... paste them into
    the full frame, (height, width) of ``intrinsics``.

    window: where the arrays below lie in the delivered frame.
    clean_m, noisy_m: (window) float32 metres along the optical axis, 0 = no return.
    infrared: (window) float32, 16-bit counts. reason: (window) uint8 Reason codes.
    region_codes: (window) uint8 parts of the face as ``region_numbers`` (name -> number) has them,
        0 = none; None where they were not asked for.
    extra: any further layers that a stage wrote, by name.
    depth_unit_mm: the millimetres that one step of ``clean`` and ``noisy`` stands for.
    depth_offset_mm: what was subtracted from every depth (0 unless normalised).
    seed: the frame's own 64-bit seed. parameters: "stage.parameter" -> the value that was drawn.
    pose: distance_mm, yaw_deg, ... as drawn.
    """

    key: FaceKey
    source: str
    seed: int
    intrinsics: Intrinsics
    window: Rect
    clean_m: NDArray[np.float32]
    noisy_m: NDArray[np.float32]
    infrared_counts: NDArray[np.float32]
    reason_codes: NDArray[np.uint8]
    region_codes: NDArray[np.uint8] | None = None
    region_numbers: Mapping[str, int] = field(default_factory=dict)
    extra: Mapping[str, NDArray[np.float32]] = field(default_factory=dict)
    depth_unit_mm: float = 1.0
    depth_offset_mm: float = 0.0
    pose: Mapping[str, float] = field(default_factory=dict)
    expression: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    notes: Mapping[str, object] = field(default_factory=dict)

    @property
    def clean(self) -> NDArray[np.uint16]:
        """(H, W) uint16 clean depth in steps of depth_unit_mm, 0 = no surface."""
        return self._paste(encode_depth(self.clean_m, self.depth_unit_mm))

    @property
    def noisy(self) -> NDArray[np.uint16]:
        """(H, W) uint16 noisy depth in steps of depth_unit_mm, 0 = no return."""
        return self._paste(encode_depth(self.noisy_m, self.depth_unit_mm))

    @property
    def infrared(self) -> NDArray[np.uint16]:
        """(H, W) uint16 infrared counts."""
        counts = np.clip(np.rint(self.infrared_counts), 0, _UINT16_MAX)
        return self._paste(counts.astype(np.uint16))

    @property
    def reason(self) -> NDArray[np.uint8]:
        """(H, W) uint8 codes of glsim.reason.Reason."""
        return self._paste(self.reason_codes, fill=int(Reason.NO_SURFACE))

    @property
    def regions(self) -> NDArray[np.uint8]:
        """(H, W) uint8 parts of the face, 0 = none. Raises ConfigError if they were not drawn."""
        if self.region_codes is None:
            raise ConfigError(f"{self.source}: this frame was made without the layer 'regions'")
        return self._paste(self.region_codes)

    @property
    def seen_regions(self) -> dict[str, int]:
        """Name -> number of the parts of the face that at least one pixel shows."""
        seen = np.unique(self.regions)
        return {name: number for name, number in self.region_numbers.items() if number in seen}

    def image(self, layer: str) -> NDArray[np.uint16] | NDArray[np.uint8]:
        """A layer that can be written, by its name. Raises ConfigError for another."""
        if layer not in WRITABLE:
            raise ConfigError(f"no such layer {layer!r}: {did_you_mean(layer, WRITABLE)}")
        image: NDArray[np.uint16] | NDArray[np.uint8] = getattr(self, layer)
        return image

    def _paste(self, part: NDArray[_T], fill: int = 0) -> NDArray[_T]:
        shape = (self.intrinsics.height, self.intrinsics.width)
        if part.shape == shape:
            return part
        full = np.zeros(shape, part.dtype) if fill == 0 else np.full(shape, fill, part.dtype)
        full[self.window.slices] = part
        return full


@dataclass(frozen=True)
class Skipped:
    """A frame that could not be made, and why (one line)."""

    key: FaceKey
    source: str
    why: str
