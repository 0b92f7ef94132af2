"""Export formats of floating-point depth: NPY, NPZ with all data of a frame, and OpenEXR."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.depth_frame import DepthFrame
from glsim.core.files.atomic import to_json
from glsim.core.files.exr import encode_exr
from glsim.core.files.npy import encode_npy
from glsim.data.export.exported_frame import Export, depth_layers, surface_normals
from glsim.data.export.formats.cameras import centre_at_zero, coefficients

#: Time of each file in an NPZ archive, the earliest that ZIP allows: equal frames give equal bytes.
_NO_TIME = (1980, 1, 1, 0, 0, 0)


def encode_npz(frame: DepthFrame) -> bytes:
    """Encode all data of a frame as an NPZ file.

    For each depth layer LAYER: LAYER_m, LAYER_points_m (H, W, 3) and LAYER_normals (H, W, 3).
    infrared, reason, regions as stored. K: (3, 3) with the first pixel's centre at (0, 0);
    distortion: k1, k2, p1, p2, k3; head_to_camera (4, 4), landmarks_m (68, 3) and landmarks_px
    (68, 2, first centre at 0) if the record has them; record: the manifest's line, JSON.
    """
    arrays: dict[str, NDArray[Any]] = {}
    for layer in depth_layers(frame):
        arrays[f"{layer}_m"] = frame.in_metres(f"{layer}_mm")
        arrays[f"{layer}_points_m"] = frame.points(f"{layer}_mm")
        arrays[f"{layer}_normals"] = surface_normals(frame, layer)
    arrays |= {n: frame.layer(n) for n in ("infrared", "reason", "regions") if n in frame}
    arrays["K"] = centre_at_zero(frame.intrinsics)
    arrays["distortion"] = np.array(coefficients(frame.lens))
    if "head_to_camera" in frame.record:
        arrays["head_to_camera"] = np.array(frame.record["head_to_camera"], np.float64)
    if "landmarks" in frame.record:
        arrays["landmarks_m"] = np.array(frame.record["landmarks"]["points_m"], np.float64)
        arrays["landmarks_px"] = np.array(frame.record["landmarks"]["pixels"], np.float64) - 0.5
    arrays["record"] = np.array(to_json(frame.record, frame.name))
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as file:
        for name, array in arrays.items():
            info = zipfile.ZipInfo(f"{name}.npy", _NO_TIME)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            file.writestr(info, encode_npy(array), compresslevel=1)
    return data.getvalue()


def _each_depth(
    frame: DepthFrame, suffix: str, encode: Callable[[NDArray[np.float32]], bytes]
) -> Iterator[tuple[str, bytes]]:
    """Yield the end of the name and the bytes of a file for each depth layer, in metres."""
    for layer in depth_layers(frame):
        yield f"_{layer}.{suffix}", encode(frame.in_metres(f"{layer}_mm"))


ARRAYS = (
    Export("npy", "float depth, metres", lambda frame: _each_depth(frame, "npy", encode_npy)),
    Export(
        "exr", "float depth, metres, OpenEXR (needs OpenEXR)",
        lambda frame: _each_depth(frame, "exr", encode_exr), library="OpenEXR",
    ),
    Export(
        "npz", "all of a frame: depth, points, normals, camera, pose, landmarks, record",
        lambda frame: [(".npz", encode_npz(frame))],
    ),
)  # fmt: skip
