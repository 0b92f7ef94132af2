"""Export of point clouds: binary PLY in metres, with normals, regions and infrared.

G. Turk, "The PLY Polygon File Format", 1994.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.core.depth_frame import DepthFrame
from glsim.data.export.exported_frame import Export, depth_layers, surface_normals

#: NumPy's kind and size of a field -> name in PLY. Open3D does not read "ushort", PLY's older name.
_PLY = {"f4": "float", "u1": "uchar", "u2": "uint16"}


def point_cloud(frame: DepthFrame, layer: str) -> NDArray[np.void]:
    """Return a record array (N,) of the pixels with depth, row by row.

    Fields: x, y, z float32 metres in the camera frame (x right, y down, z forward); nx, ny, nz
    float32 unit normal towards the camera; region uint8 and infrared uint16 counts if present.
    """
    seen = frame.layer(f"{layer}_mm") > 0
    fields = [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    if "regions" in frame:
        fields.append(("region", "u1"))
    if frame.infrared is not None:
        fields.append(("infrared", "<u2"))
    cloud = np.zeros(int(seen.sum()), dtype=fields)
    points, normals = frame.points(f"{layer}_mm")[seen], surface_normals(frame, layer)[seen]
    for number, name in enumerate("xyz"):
        cloud[name], cloud[f"n{name}"] = points[:, number], normals[:, number]
    if "regions" in frame:
        cloud["region"] = frame.regions[seen]
    if frame.infrared is not None:
        cloud["infrared"] = frame.infrared[seen]
    return cloud


def encode_ply(cloud: NDArray[np.void], frame: DepthFrame) -> bytes:
    """Encode a point cloud as binary PLY; comments state unit, axes and region names."""
    kinds = {name: cloud.dtype[name].str.lstrip("<|") for name in cloud.dtype.names or ()}
    regions = np.unique(cloud["region"]).tolist() if "region" in kinds else []
    names = {number: name for name, number in frame.record.get("regions", {}).items()}
    named = [(number, names[number]) for number in regions if number in names]
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment metres, camera frame: x right, y down, z forward",
        *(f"comment region {n} {name}" for n, name in named),
        f"element vertex {len(cloud)}",
        *(f"property {_PLY[kind]} {name}" for name, kind in kinds.items()),
        "end_header",
    ]
    return "\n".join(header).encode("ascii", "replace") + b"\n" + cloud.tobytes()


POINT_CLOUDS = Export(
    "ply",
    "point clouds: metres, normals, region, infrared",
    lambda frame: (
        (f"_{layer}.ply", encode_ply(point_cloud(frame, layer), frame))
        for layer in depth_layers(frame)
    ),
)
