"""Depth as floating arrays: NPY, NPZ with everything of a frame, and OpenEXR."""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.exports.export import Export
from glsim.exports.formats.cameras import centre_at_zero, coefficients
from glsim.exports.frames import ExportFrame
from glsim.files.atomic import to_json

#: The first time that a ZIP file can hold: the same frame gives the same bytes.
_NO_TIME = (1980, 1, 1, 0, 0, 0)


def encode_npy(array: NDArray[Any]) -> bytes:
    """Return an NPY file."""
    data = io.BytesIO()
    np.save(data, np.asarray(array, order="C"), allow_pickle=False)  # keeps () of a text
    return data.getvalue()


def encode_npz(frame: ExportFrame) -> bytes:
    """Return an NPZ file with all that is known of a frame.

    Of each depth layer LAYER: LAYER_m, LAYER_points_m (H, W, 3) and LAYER_normals (H, W, 3).
    infrared, reason, regions as stored. K: (3, 3) with the first pixel's centre at (0, 0);
    distortion: k1, k2, p1, p2, k3; head_to_camera (4, 4), landmarks_m (68, 3) and landmarks_px
    (68, 2, first centre at 0) if the record has them; record: the manifest's line, JSON.
    """
    arrays: dict[str, NDArray[Any]] = {}
    for layer, depth_m in frame.depth_m.items():
        arrays[f"{layer}_m"] = depth_m
        arrays[f"{layer}_points_m"] = frame.points(layer)
        arrays[f"{layer}_normals"] = frame.normals(layer)
    for name in ("infrared", "reason", "regions"):
        image = getattr(frame, name)
        if image is not None:
            arrays[name] = image
    arrays["K"] = centre_at_zero(frame.camera)
    arrays["distortion"] = np.array(coefficients(frame.lens))
    arrays |= geometry_arrays(frame)
    arrays["record"] = np.array(to_json(frame.record, frame.stem))
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as file:
        for name, array in arrays.items():
            info = zipfile.ZipInfo(f"{name}.npy", _NO_TIME)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            file.writestr(info, encode_npy(array), compresslevel=1)
    return data.getvalue()


def geometry_arrays(frame: ExportFrame) -> dict[str, NDArray[Any]]:
    """Return head_to_camera, landmarks_m and landmarks_px of a record that has them.

    Pixels are those of programs that give the first pixel's centre the coordinates (0, 0).
    """
    arrays: dict[str, NDArray[Any]] = {}
    if "head_to_camera" in frame.record:
        arrays["head_to_camera"] = np.array(frame.record["head_to_camera"], np.float64)
    if "landmarks" in frame.record:
        arrays["landmarks_m"] = np.array(frame.record["landmarks"]["points_m"], np.float64)
        arrays["landmarks_px"] = np.array(frame.record["landmarks"]["pixels"], np.float64) - 0.5
    return arrays


def encode_exr(depth_m: NDArray[np.float32]) -> bytes:
    """Return an OpenEXR file of one part with the float32 channel Y; 16 rows a ZIP block.

    Y is luminance: programs read a file with this channel alone as one grey image.
    The container is written here (OpenEXR file layout, version 2, Academy Software Foundation):
    the wheels of OpenCV 5 are built without OpenEXR.
    """
    height, width = depth_m.shape
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    channel = b"Y\0" + struct.pack("<iB3xii", 2, 0, 1, 1) + b"\0"  # FLOAT, every pixel
    attributes = [
        ("channels", "chlist", channel),
        ("compression", "compression", b"\x03"),  # ZIP_COMPRESSION
        ("dataWindow", "box2i", window),
        ("displayWindow", "box2i", window),
        ("lineOrder", "lineOrder", b"\0"),  # rows from the top
        ("pixelAspectRatio", "float", struct.pack("<f", 1)),
        ("screenWindowCenter", "v2f", struct.pack("<2f", 0, 0)),
        ("screenWindowWidth", "float", struct.pack("<f", 1)),
    ]
    header = struct.pack("<ii", 20000630, 2)
    for name, kind, value in attributes:
        header += f"{name}\0{kind}\0".encode() + struct.pack("<i", len(value)) + value
    header += b"\0"
    rows = np.ascontiguousarray(depth_m, "<f4")
    blocks = []
    for top in range(0, height, _EXR_ROWS):
        raw = rows[top : top + _EXR_ROWS].tobytes()
        packed = _predicted(raw)
        data = packed if len(packed) < len(raw) else raw
        blocks.append(struct.pack("<ii", top, len(data)) + data)
    starts = np.cumsum([len(header) + 8 * len(blocks), *map(len, blocks[:-1])])
    return header + starts.astype("<u8").tobytes() + b"".join(blocks)


#: Rows in a block of EXR's ZIP compression.
_EXR_ROWS = 16


def _predicted(raw: bytes) -> bytes:
    """Compress as EXR's ZIP does: even bytes, odd bytes, differences plus 128, deflate."""
    data = np.frombuffer(raw, np.uint8)
    order = np.concatenate([data[0::2], data[1::2]])
    change = order.copy()
    change[1:] = order[1:] - order[:-1] + np.uint8(128)  # modulo 256
    return zlib.compress(change.tobytes(), 4)


ARRAYS = (
    Export(
        "npy",
        "float depth, metres",
        lambda frame: ((f"_{name}.npy", encode_npy(z)) for name, z in frame.depth_m.items()),
    ),
    Export(
        "exr",
        "float depth, metres, OpenEXR",
        lambda frame: ((f"_{name}.exr", encode_exr(z)) for name, z in frame.depth_m.items()),
    ),
    Export(
        "npz",
        "all of a frame: depth, points, normals, camera, pose, landmarks, record",
        lambda frame: [(".npz", encode_npz(frame))],
    ),
)
