"""The simulated frame, and its conversion to a measured depth frame."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array, Floats, Mask, Reals
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import DepthFrame, FrameKey, Layer
from glsim.core.errors import ConfigError, did_you_mean
from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.core.units import MM_PER_M, UINT16_MAX, from_steps, to_mm, to_steps

if TYPE_CHECKING:
    from glsim.faces.face_source import FaceKey

_T = TypeVar("_T", bound=np.generic)

#: _ZERO encodes a normal's component 0, _STEPS more is 1. -1 is encoded as 1: 0 is "no surface".
_ZERO, _STEPS = 32768, 32767

#: The images of every frame: clean, noisy and infrared are uint16, reason is uint8.
LAYERS = ("clean", "noisy", "infrared", "reason")
#: The images that can be written to files. Rendered on request only: regions (uint8), expected
#: (uint16), normals (uint16, three channels), color (uint8, three channels), and the second
#: infrared image of stereo cameras (uint16).
WRITABLE = (*LAYERS, "regions", "expected", "normals", "infrared_right", "color")


def refuse_millimetres(depth: Reals, near_m: float, far_m: float) -> None:
    """Raise ConfigError if depths that should be metres look like millimetres.

    Metres of this size would be beyond the sensor's far plane, and the result would be empty. Other
    maps without any depth between the planes are warned of, also those of one distance: simulators
    put an empty background at their far plane.
    """
    seen = depth[(depth > 0) & (depth < np.inf)]
    nearest, farthest = float(seen.min(initial=np.inf)), float(seen.max(initial=0))
    if not seen.size or (nearest <= far_m and farthest >= near_m):
        return
    span = f"{nearest:g}" if nearest == farthest else f"{nearest:g} to {farthest:g}"
    in_mm = MM_PER_M * near_m <= nearest and float(np.median(seen)) <= MM_PER_M * far_m
    if in_mm and nearest < farthest:
        raise ConfigError(
            f"depth is {span}: this is millimetres, and metres are wanted: give depth / 1000"
        )
    how = "of millimetres give depth / 1000" if nearest > far_m else "give metres"
    text = f"all depth is {span} m, the sensor sees {near_m:g} to {far_m:g} m: {how}"
    warnings.warn(text, stacklevel=3)


def encode_normals(normals: Reals, seen: Mask) -> NDArray[np.uint16]:
    """Encode unit normals (..., 3) as uint16; pixels where ``seen`` is False become 0, 0, 0."""
    codes = np.rint(np.clip(normals, -1, 1) * _STEPS) + _ZERO
    return np.where(seen[..., None], codes, 0).astype(np.uint16)


def decode_normals(codes: NDArray[np.uint16]) -> Floats:
    """Decode uint16 codes to float32 unit normals, (..., 3); 0 where there is no surface."""
    seen = codes.any(axis=-1, keepdims=True)
    normals = (codes.astype(np.float32) - _ZERO) / _STEPS
    length = np.linalg.norm(normals, axis=-1, keepdims=True)
    return np.where(seen, normals / np.where(seen, length, 1), 0).astype(np.float32)


def _encode_counts(counts: Floats) -> NDArray[np.uint16]:
    return np.clip(np.rint(counts), 0, UINT16_MAX).astype(np.uint16)


@dataclass(frozen=True, eq=False)
class Landmarks:
    """The 68 landmarks of a face in the order of Multi-PIE (and iBUG), in the delivered frame.

    Attributes:
        points_m: (68, 3) float64, camera frame, metres.
        pixels: (68, 2) float64 x, y, also outside the image; the first pixel's centre is at 0.5.
        visible: (68,) whether the clean depth at the pixel agrees with the landmark's depth.
    """

    points_m: Array
    pixels: Array
    visible: Mask


@dataclass(frozen=True, eq=False)
class Frame:
    """A clean and a noisy depth map of one face, with the parameters of their simulation.

    The fields hold the window of the image that is not empty; the properties ``clean``, ``noisy``,
    ``infrared``, ``reason``, ``regions`` and ``expected`` paste it into the frame, (height, width)
    of ``intrinsics``.

    intrinsics: pinhole camera of the delivered frame, crop included.
    window: position of the arrays in the delivered frame; (h, w) below is its size.
    clean_m, noisy_m: (h, w) float32 metres along the optical axis, 0 = no surface or no return.
    expected_m: (h, w) float32 metres, the clean depth with the device's systematic error, but
        without noise, blur, edges and fixed pattern; > 0 where clean is. None if not requested.
    normal: (h, w, 3) float32 unit normals of the meshes, camera frame; None if not requested.
    head_to_camera: (4, 4) float64 from the canonical head frame (x the subject's left, y up, z out
        of the face), metres, to the camera frame, metres; None if there is no head.
    landmarks: the 68 landmarks of the face; None if not requested or not known.
    infrared_counts: (h, w) float32 counts of the 16-bit image.
    color_rgb: (h, w, 3) uint8, see glsim.simulation.color_image; None if not requested.
    infrared_right_counts: the same for a stereo camera's second imager; None if not requested.
    reason_codes: (h, w) uint8 codes of glsim.core.reason.Reason.
    region_codes: (h, w) uint8 numbers of face parts, 0 = none; None if not requested.
    region_numbers: part of the face -> its number.
    extra: further float32 layers of the stages, by name.
    depth_unit_mm: millimetres per step of ``clean``, ``expected`` and ``noisy``.
    depth_offset_mm: millimetres subtracted from every depth (0 unless normalised).
    pose: sampled distance_mm, yaw_deg, ..., plus the motion of generated heads.
    expression: action unit or blend shape -> intensity in [0, 1].
    parameters: "stage.parameter" -> sampled value, without constants.
    notes: further JSON values about the face, from its source.
    """

    key: FaceKey
    source: str
    seed: int
    intrinsics: Intrinsics
    window: Rect
    clean_m: Floats
    noisy_m: Floats
    infrared_counts: Floats
    reason_codes: NDArray[np.uint8]
    region_codes: NDArray[np.uint8] | None = None
    expected_m: Floats | None = None
    normal: Floats | None = None
    color_rgb: NDArray[np.uint8] | None = None
    infrared_right_counts: Floats | None = None
    head_to_camera: Array | None = None
    landmarks: Landmarks | None = None
    region_numbers: Mapping[str, int] = field(default_factory=dict)
    extra: Mapping[str, Floats] = field(default_factory=dict)
    depth_unit_mm: float = 1.0
    depth_offset_mm: float = 0.0
    pose: Mapping[str, float] = field(default_factory=dict)
    expression: Mapping[str, float] = field(default_factory=dict)
    parameters: Mapping[str, float] = field(default_factory=dict)
    notes: Mapping[str, object] = field(default_factory=dict)

    @property
    def clean(self) -> NDArray[np.uint16]:
        """Clean depth, (H, W) uint16 in steps of depth_unit_mm, 0 = no surface."""
        return self._paste(to_steps(self.clean_m, self.depth_unit_mm))

    @property
    def noisy(self) -> NDArray[np.uint16]:
        """Noisy depth, (H, W) uint16 in steps of depth_unit_mm, 0 = no return."""
        return self._paste(to_steps(self.noisy_m, self.depth_unit_mm))

    @property
    def expected(self) -> NDArray[np.uint16]:
        """Clean depth with the systematic error, (H, W) uint16; ConfigError if not requested."""
        depth_m = self._requested("expected", self.expected_m)
        return self._paste(to_steps(depth_m, self.depth_unit_mm))

    @property
    def infrared(self) -> NDArray[np.uint16]:
        """Infrared image, (H, W) uint16 counts."""
        return self._paste(_encode_counts(self.infrared_counts))

    @property
    def infrared_right(self) -> NDArray[np.uint16]:
        """Counts of a stereo camera's second imager, uint16; ConfigError if not requested."""
        counts = self._requested("infrared_right", self.infrared_right_counts)
        return self._paste(_encode_counts(counts))

    @property
    def reason(self) -> NDArray[np.uint8]:
        """Reason for each pixel's state, (H, W) uint8 codes of glsim.core.reason.Reason."""
        return self._paste(self.reason_codes, fill=int(Reason.NO_SURFACE))

    @property
    def regions(self) -> NDArray[np.uint8]:
        """Region numbers, (H, W) uint8, 0 = none; ConfigError if not requested."""
        return self._paste(self._requested("regions", self.region_codes))

    @property
    def normals(self) -> NDArray[np.uint16]:
        """Normals, (H, W, 3) uint16, see ``encode_normals``; ConfigError if not requested."""
        normal = self._requested("normals", self.normal)
        return self._paste(encode_normals(normal, self.clean_m > 0))

    @property
    def color(self) -> NDArray[np.uint8]:
        """Colour image, (H, W, 3) uint8 sRGB; ConfigError if not requested."""
        return self._paste(self._requested("color", self.color_rgb))

    @property
    def seen_regions(self) -> dict[str, int]:
        """Face regions that cover at least one pixel, name -> number."""
        seen = np.unique(self.regions)
        return {name: number for name, number in self.region_numbers.items() if number in seen}

    def image(self, layer: str) -> NDArray[np.uint16] | NDArray[np.uint8]:
        """Return the image of a layer in WRITABLE. Raises ConfigError for another name."""
        if layer not in WRITABLE:
            raise ConfigError(f"no such layer {layer!r}: {did_you_mean(layer, WRITABLE)}")
        image: NDArray[np.uint16] | NDArray[np.uint8] = getattr(self, layer)
        return image

    def measured(self, name: str = "", *, rounded: bool = True) -> DepthFrame:
        """Convert to a depth frame of the whole delivered image, in millimetres from the camera.

        It has noisy_mm, clean_mm, infrared, reason, and the other requested layers; each is
        computed at its first use. With ``rounded``, depths are whole steps and infrared is whole
        counts, as in files; otherwise both are unrounded results of the noise stages. The default
        name is the frame's key.
        """
        layers: dict[str, Layer] = {
            "noisy_mm": partial(self._depth_mm, "noisy", rounded),
            "clean_mm": partial(self._depth_mm, "clean", rounded),
            "infrared": partial(self._paste, self.infrared_counts),
            "reason": partial(getattr, self, "reason"),
        }
        if self.expected_m is not None:
            layers["expected_mm"] = partial(self._depth_mm, "expected", rounded)
        if self.region_codes is not None:
            layers["regions"] = partial(getattr, self, "regions")
        if self.normal is not None:
            layers["normals"] = partial(self._paste, self.normal)
        if rounded:
            layers["infrared"] = partial(getattr, self, "infrared")
        layers |= {layer: partial(self._paste, values) for layer, values in self.extra.items()}
        return DepthFrame(
            FrameKey(self.key.subject, self.key.sequence, self.key.frame),
            self.intrinsics,
            layers,
            step_mm=self.depth_unit_mm,
            name=name,
        )

    def _depth_mm(self, layer: str, rounded: bool) -> Floats:
        if rounded:
            return from_steps(getattr(self, layer), self.depth_unit_mm, self.depth_offset_mm)
        depth_mm = to_mm(self._paste(getattr(self, f"{layer}_m")))
        seen = depth_mm > 0
        return np.add(depth_mm, np.float32(self.depth_offset_mm), out=depth_mm, where=seen)

    def _requested(self, layer: str, values: NDArray[_T] | None) -> NDArray[_T]:
        if values is None:
            raise ConfigError(f"{self.source}: this frame was made without the layer {layer!r}")
        return values

    def _paste(self, part: NDArray[_T], fill: int = 0) -> NDArray[_T]:
        shape: tuple[int, ...] = (self.intrinsics.height, self.intrinsics.width)
        if part.shape[:2] == shape:
            return part
        shape = (*shape, *part.shape[2:])
        full = np.zeros(shape, part.dtype) if fill == 0 else np.full(shape, fill, part.dtype)
        full[self.window.slices] = part
        return full


@dataclass(frozen=True)
class Skipped:
    """A frame that could not be made, with the reason in one line."""

    key: FaceKey
    source: str
    why: str
