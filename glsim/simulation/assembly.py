"""Assemble a Frame from the layers of a noise chain: crop, mask, match reasons, normalise."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array, Floats
from glsim.core.arrays import of
from glsim.core.camera import Intrinsics
from glsim.core.depth_protocol import offset_to_nearest
from glsim.core.errors import ConfigError
from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.core.units import MM_PER_M, subtract_offset
from glsim.noise.twins.layers import Image, has_depth, select
from glsim.settings.schema import OutputSettings
from glsim.simulation.frame import Frame, Landmarks


def assemble_frame(
    layers: Mapping[str, NDArray[Any]],
    window: Rect,
    crop: Rect,
    image: Intrinsics,
    output: OutputSettings,
    extra: Sequence[str] = (),
    **identity: Any,
) -> Frame:
    """Make a Frame: crop the layers, match the reasons to the depths, apply the output settings.

    Raises ConfigError if a stage wrote NaN or infinity.

    Args:
        layers: (h, w) float32 layers of ``window``: clean and depth in metres, reason, and
            optionally expected (metres), infrared (counts), region, normal and color (uint8).
        window: the rectangle of ``image`` that the layers hold.
        crop: the rectangle of ``image`` that is delivered.
        extra: names of layers to copy to ``Frame.extra``.
        identity: the other fields of Frame.
    """
    visible = window.intersection(crop)
    left, top = visible.left - window.left, visible.top - window.top
    inside = Rect(left, top, visible.width, visible.height).slices
    for name in ("depth", "reason", "infrared", "infrared_right", "expected"):
        if name in layers and not np.isfinite(layers[name][inside]).all():
            bad = int((~np.isfinite(layers[name][inside])).sum())
            raise ConfigError(
                f"the noise stages left NaN or infinity in {bad} pixels of the {name}"
            )
    none = np.float32(0.0)
    clean, noisy = layers["clean"][inside], np.maximum(layers["depth"][inside], none)
    reason = reconcile_reasons(clean, noisy, layers["reason"][inside]).astype(np.uint8)
    if output.clean_mask == "as-noisy":
        clean = np.where(noisy > 0, clean, none)
    step_m, offset_mm = output.depth_unit_mm / MM_PER_M, 0.0
    expected = layers.get("expected")
    if expected is not None:  # at least one step where clean has depth
        expected = np.where(clean > 0, np.maximum(expected[inside], np.float32(step_m)), none)
    if output.nearest_to_mm is not None and (clean > 0).any():
        offset_mm = MM_PER_M * offset_to_nearest(clean, 0.0) - output.nearest_to_mm
        move = partial(subtract_offset, offset=offset_mm / MM_PER_M, least=step_m)
        clean, noisy = move(clean), move(noisy)
        expected = None if expected is None else move(expected)
    infrared, region = layers.get("infrared"), layers.get("region")
    right = layers.get("infrared_right")
    return Frame(
        intrinsics=image.cropped(*crop),
        window=visible._replace(left=visible.left - crop.left, top=visible.top - crop.top),
        clean_m=clean,
        noisy_m=noisy,
        infrared_counts=np.zeros_like(clean) if infrared is None else infrared[inside],
        infrared_right_counts=None if right is None else right[inside],
        reason_codes=reason,
        region_codes=None if region is None else region[inside].astype(np.uint8),
        expected_m=expected,
        depth_unit_mm=output.depth_unit_mm,
        depth_offset_mm=offset_mm,
        color_rgb=layers["color"][inside] if "color" in layers else None,
        normal=layers["normal"][inside][..., :3] if "normal" in layers else None,
        extra={name: _cut(layers[name], window, inside) for name in extra if name in layers},
        **identity,
    )


def seen_landmarks(points_m: Array, frame: Frame) -> Landmarks:
    """Project landmarks, (68, 3) camera-frame metres, into a frame and test their visibility.

    A landmark is visible if the clean depth of its pixel is within 5 mm (chosen) of its depth, a
    vertex's: the surface changes by less within a pixel unless it is seen edge on.
    """
    pixels = frame.intrinsics.project(points_m)
    column, row = np.floor(pixels - (frame.window.left, frame.window.top)).astype(np.int64).T
    height, width = frame.clean_m.shape
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    clean = frame.clean_m[row.clip(0, height - 1), column.clip(0, width - 1)]
    depth = points_m[:, 2] - frame.depth_offset_mm / MM_PER_M
    return Landmarks(points_m, pixels, inside & (clean > 0) & (np.abs(clean - depth) < 0.005))


def _cut(layer: Floats, window: Rect, inside: tuple[slice, slice]) -> Any:
    """Crop a layer to a part of ``window``; the layer may have several samples per pixel."""
    factor = max(layer.shape[1] // window.width, 1)
    rows, columns = (slice(factor * s.start, factor * s.stop) for s in inside)
    return layer[rows, columns]


def reconcile_reasons(clean_m: Image, noisy_m: Image, reason: Image) -> Image:
    """Return float32 Reason codes that agree with the depths, m, even if no stage set a reason."""
    xp = of(reason)
    reason = xp.where(reason > max(Reason) + 0.5, float(Reason.DROPPED), xp.round(reason))
    seen, found, expects = clean_m > 0, noisy_m > 0, has_depth(reason)
    return select(
        [
            (~found & expects & seen, float(Reason.DROPPED)),
            (~found & expects, float(Reason.NO_SURFACE)),
            (found & (~expects | (reason == Reason.VALID)) & ~seen, float(Reason.GROWN)),
            (found & ~expects, float(Reason.VALID)),
        ],
        reason,
    )
