"""From the layers that a chain leaves to a delivered Frame: crop, masks, reasons, normalisation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.camera import Intrinsics
from glsim.config import OutputSettings
from glsim.errors import ConfigError
from glsim.frame import Frame, Rect
from glsim.reason import Reason

_WITH_DEPTH = np.array([Reason(r).has_depth for r in sorted(Reason)])


def finish(
    layers: Mapping[str, NDArray[np.float32]],
    window: Rect,
    crop: Rect,
    image: Intrinsics,
    output: OutputSettings,
    extra: Sequence[str] = (),
    **identity: Any,
) -> Frame:
    """The delivered frame.

    layers: (h, w) float32 of ``window``, with depth and clean in metres; region where wanted.
    crop: what is delivered of the sensor's image. extra: names of layers that go along as they
    are. identity: the fields of Frame that name it.
    Raises ConfigError if a stage left NaN or infinity behind.
    """
    visible = window.intersection(crop)
    inside = Rect(
        visible.left - window.left, visible.top - window.top, visible.width, visible.height
    ).slices
    clean, noisy = layers["clean"][inside], layers["depth"][inside]
    for name in ("depth", "reason", "infrared"):
        if name in layers and not np.isfinite(layers[name][inside]).all():
            bad = int((~np.isfinite(layers[name][inside])).sum())
            raise ConfigError(
                f"the noise stages left NaN or infinity in {bad} pixels of the {name}"
            )
    noisy = np.maximum(noisy, np.float32(0.0))
    reason = explain(clean, noisy, layers["reason"][inside])
    if output.clean_mask == "as-noisy":
        clean = np.where(noisy > 0, clean, np.float32(0.0))
    offset_mm = 0.0
    if output.nearest_to_mm is not None and (clean > 0).any():
        offset_mm = float(clean[clean > 0].min()) * 1000.0 - output.nearest_to_mm
        clean, noisy = (_shifted(depth, offset_mm, output) for depth in (clean, noisy))
    infrared, region = layers.get("infrared"), layers.get("region")
    return Frame(
        intrinsics=image.cropped(*crop),
        window=visible._replace(left=visible.left - crop.left, top=visible.top - crop.top),
        clean_m=clean,
        noisy_m=noisy,
        infrared_counts=np.zeros_like(clean) if infrared is None else infrared[inside],
        reason_codes=reason,
        region_codes=None if region is None else region[inside].astype(np.uint8),
        depth_unit_mm=output.depth_unit_mm,
        depth_offset_mm=offset_mm,
        extra={name: layers[name][inside] for name in extra if name in layers},
        **identity,
    )


def explain(
    clean_m: NDArray[np.float32], noisy_m: NDArray[np.float32], reason: NDArray[np.float32]
) -> NDArray[np.uint8]:
    """uint8 Reason codes that agree with the depth, whatever the stages forgot to say."""
    codes = np.rint(reason).astype(np.uint8)
    codes[codes >= len(_WITH_DEPTH)] = Reason.DROPPED
    says_depth, has_depth = _WITH_DEPTH[codes], noisy_m > 0
    codes[~has_depth & says_depth & (clean_m > 0)] = Reason.DROPPED
    codes[~has_depth & says_depth & (clean_m <= 0)] = Reason.NO_SURFACE
    codes[has_depth & ~says_depth] = Reason.VALID
    codes[has_depth & (codes == Reason.VALID) & (clean_m <= 0)] = Reason.GROWN
    return codes


def _shifted(
    depth_m: NDArray[np.float32], offset_mm: float, output: OutputSettings
) -> NDArray[np.float32]:
    """Depths nearer by ``offset_mm``; what has depth keeps at least one unit."""
    least_m = np.float32(output.depth_unit_mm / 1000.0)
    moved = np.maximum(depth_m - np.float32(offset_mm / 1000.0), least_m)
    return np.where(depth_m > 0, moved, np.float32(0.0))
