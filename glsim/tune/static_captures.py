"""Captured clean layers in few bytes, for the page without a server.

A scene holds a capture per sensor: the clean layers of the frame's window as integers, in blobs
that captures share. assets/static/captures.js unpacks them:

    clean          16 bits  depth in DEPTH_M
    shape           8 bits  x and y of the normal in 1/NORMAL, + NORMAL; albedo in ALBEDO
    lit             8 bits  in LIT
    uneven          8 bits  rigs that supersample: in UNEVEN_M, at least 1 where it is not 0
    samples        16 bits  their samples' depth minus the pixel's, of the pixels above MIXED_ABOVE
    sample_albedo   8 bits  and albedo minus the pixel's

A blob: each number minus what its neighbours above and to the left predict (left + above - above
left), modulo 2^bits; signs folded into the lowest bit; low bytes, then high bytes; zlib; base 85
(``base64.b85encode``, with . for <, which would end a script).
Blobs of samples are not predicted.
"""

from __future__ import annotations

import base64
import hashlib
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.frame import Frame
from glsim.noise.frame_context import FrameContext
from glsim.noise.registry import shipped_stages
from glsim.noise.stage_pass import bound_values
from glsim.sensors.sensor import Sensor
from glsim.settings.seeds import stable_seed

#: Steps of the integers. Chosen: depth to an eighth of a millimetre reaches 8.19 m and stays far
#: below the noise of the quietest sensor (0.3 mm); 63 steps of a normal's x and y are a degree;
#: 252 is divisible by the numbers of points of an emitter.
DEPTH_M, NORMAL, ALBEDO, LIT, UNEVEN_M = 0.000125, 63, 1 / 170, 1 / 252, 1e-5
#: Pixels that keep their samples: those that tof_light does not evaluate at their centre.
MIXED_ABOVE = round(
    0.001 * shipped_stages()["tof_light"].parameters["smooth_mm"].default / UNEVEN_M
)
UNITS = {
    "depth_m": DEPTH_M, "normal": NORMAL, "albedo": ALBEDO, "lit": LIT,
    "uneven_m": UNEVEN_M, "mixed_above": MIXED_ABOVE,
}  # fmt: skip

#: The layers that ``pack_capture`` needs, for ``Simulator(..., extra_layers=...)``.
CAPTURED_LAYERS = ("normal", "albedo", "lit", "uneven", "fine_seen")

#: Integer layers by name, (planes, h, w) uint8 or uint16.
Integers = Mapping[str, NDArray[Any]]


def whole_numbers(frame: Frame, side: int) -> dict[str, NDArray[Any]]:
    """Round a frame's clean layers to integers, (planes, h, w).

    Args:
        frame: with CAPTURED_LAYERS as extra layers.
        side: samples along each axis of a pixel.
    """
    clean = _steps(frame.clean_m, DEPTH_M, np.uint16)
    normal, seen = frame.extra["normal"], frame.clean_m > 0
    across = [np.where(seen, np.rint(normal[..., n] * NORMAL), 0) + NORMAL for n in (0, 1)]
    albedo = _steps(frame.extra["albedo"], ALBEDO, np.uint8)
    made = {
        "clean": clean[None],
        "shape": np.stack([*(a.astype(np.uint8) for a in across), albedo]),
        "lit": _steps(frame.extra["lit"], LIT, np.uint8)[None],
    }
    if side == 1:
        return made
    uneven = frame.extra["uneven"]
    steps = np.maximum(_steps(uneven, UNEVEN_M, np.uint8), (uneven > 0).astype(np.uint8))
    mixed = steps > MIXED_ABOVE
    height, width = mixed.shape
    fine = frame.extra["fine_seen"].reshape(height, side, width, side, 2)
    fine = fine.transpose(1, 3, 0, 2, 4).reshape(side * side, height, width, 2)
    others = np.delete(fine, side * side // 2, axis=0)[:, mixed]
    depths = _steps(others[..., 0], DEPTH_M, np.uint16) - clean[mixed]
    albedos = _steps(others[..., 1], ALBEDO, np.uint8) - albedo[mixed]
    return made | {
        "uneven": steps[None],
        "samples": depths[:, None],
        "sample_albedo": albedos[:, None],
    }


def pack_capture(frame: Frame, sensor: Sensor, scene: str, blobs: dict[str, Any]) -> dict[str, Any]:
    """Pack a frame of ``sensor`` as JSON values and add its blobs to ``blobs``.

    Args:
        scene: its name, which the seeds of its sequence depend on.
    """
    side = sensor.rig.supersample
    layers = {}
    for name, values in whole_numbers(frame, side).items():
        key = hashlib.blake2b(
            values.tobytes(), digest_size=6, person=name[:16].encode()
        ).hexdigest()
        layers[name] = key
        if key not in blobs:
            blobs[key] = pack_blob(values, predicted=not name.startswith("sample"))
    context = frame_context(frame, sensor, scene)
    uniforms = bound_values(context.view(""))
    constant = {k: v for k, v in uniforms.items() if not k.endswith(("_seed", "_time_s"))}
    return {
        "window": list(frame.window),
        "side": side,
        "uniforms": constant,
        "sequence_seed": str(context.sequence_seed),
        "device_seed": str(context.device_seed),
        "layers": layers,
    }


def frame_context(frame: Frame, sensor: Sensor, scene: str, seed: int = 0) -> FrameContext:
    """Describe a captured frame for its stages, as the page does.

    nearest_m is the nearest captured surface, which is what tof_shadow can meet.
    """
    clean = _steps(frame.clean_m, DEPTH_M, np.uint16) * np.float32(DEPTH_M)
    return FrameContext.for_frame(
        rig=sensor.rig,
        window=frame.window,
        seed=seed,
        sequence_seed=stable_seed("sequence", scene),
        device_seed=stable_seed("device", 0, 0),
        time_s=0.0,
        nearest_m=float(clean[clean > 0].min(initial=np.inf)),
    )


def pack_blob(values: NDArray[Any], *, predicted: bool) -> dict[str, Any]:
    """Pack (planes, h, w) uint8 or uint16 as described above, as JSON values."""
    rest = values.copy()
    if predicted:
        rest[:, :, 1:] -= values[:, :, :-1]
        rest[:, 1:] -= values[:, :-1]
        rest[:, 1:, 1:] += values[:, :-1, :-1]
    bits = 8 * values.dtype.itemsize
    signed = rest.view(f"i{values.dtype.itemsize}")
    folded = ((signed << 1) ^ (signed >> (bits - 1))).view(values.dtype)
    parts = folded.astype(f"<u{values.dtype.itemsize}").view(np.uint8).reshape(-1, bits // 8).T
    packed = zlib.compress(parts.tobytes(), 9)
    return {
        "bits": bits,
        "shape": list(values.shape),
        "predicted": predicted,
        "data": base64.b85encode(packed).decode().replace("<", "."),
        "bytes": len(packed),
    }


def _steps(values: NDArray[np.float32], step: float, kind: type[Any]) -> NDArray[Any]:
    whole: NDArray[Any] = np.clip(np.rint(values / step), 0, np.iinfo(kind).max).astype(kind)
    return whole
