"""Point clouds: PLY and PCD, binary, in metres, with normals, region and infrared.

PLY: G. Turk, "The PLY Polygon File Format", 1994. PCD: Point Cloud Library, version 0.7.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.data.export.base import Export
from glsim.data.export.frames import ExportFrame

#: NumPy's kind and size of a field -> its name in PLY, and its type letter in PCD. Open3D reads
#: "uint16" and leaves out what is called "ushort", PLY's older name of the same type.
_PLY = {"f4": "float", "u1": "uchar", "u2": "uint16"}
_PCD = {"f": "F", "u": "U"}
#: The names of the normal in PCD; both have x, y, z.
_PCD_NAMES = {"nx": "normal_x", "ny": "normal_y", "nz": "normal_z"}


def point_cloud(frame: ExportFrame, layer: str) -> NDArray[np.void]:
    """Return (N,) records of the pixels with depth, in the order of rows.

    Fields: x, y, z float32 metres in the camera frame (x right, y down, z forward); nx, ny, nz
    float32 unit normal towards the camera; region uint8 and infrared uint16 counts if there are.
    """
    seen = frame.depth_m[layer] > 0
    fields = [(name, "<f4") for name in ("x", "y", "z", "nx", "ny", "nz")]
    if frame.regions is not None:
        fields.append(("region", "u1"))
    if frame.infrared is not None:
        fields.append(("infrared", "<u2"))
    cloud = np.zeros(int(seen.sum()), dtype=fields)
    for number, name in enumerate("xyz"):
        cloud[name] = frame.points(layer)[seen, number]
        cloud[f"n{name}"] = frame.normals(layer)[seen, number]
    if frame.regions is not None:
        cloud["region"] = frame.regions[seen]
    if frame.infrared is not None:
        cloud["infrared"] = frame.infrared[seen]
    return cloud


def encode_ply(cloud: NDArray[np.void], frame: ExportFrame) -> bytes:
    """Return a binary PLY file; its comments give unit, axes and the names of the regions."""
    kinds = {name: cloud.dtype[name].str.lstrip("<|") for name in _names(cloud)}
    header = [
        "ply",
        "format binary_little_endian 1.0",
        "comment metres, camera frame: x right, y down, z forward",
        *(f"comment region {n} {name}" for n, name in _named(cloud, frame)),
        f"element vertex {len(cloud)}",
        *(f"property {_PLY[kind]} {name}" for name, kind in kinds.items()),
        "end_header",
    ]
    return "\n".join(header).encode("ascii", "replace") + b"\n" + cloud.tobytes()


def encode_pcd(cloud: NDArray[np.void], frame: ExportFrame) -> bytes:
    """Return a binary PCD file, one row of points without gaps."""
    names = _names(cloud)
    kinds = [cloud.dtype[name] for name in names]
    header = [
        "# .PCD v0.7: metres, camera frame: x right, y down, z forward",
        *(f"# region {n} {name}" for n, name in _named(cloud, frame)),
        "VERSION 0.7",
        "FIELDS " + " ".join(_PCD_NAMES.get(name, name) for name in names),
        "SIZE " + " ".join(str(kind.itemsize) for kind in kinds),
        "TYPE " + " ".join(_PCD[kind.kind] for kind in kinds),
        "COUNT " + " ".join("1" for _ in kinds),
        f"WIDTH {len(cloud)}",
        "HEIGHT 1",
        "VIEWPOINT 0 0 0 1 0 0 0",
        f"POINTS {len(cloud)}",
        "DATA binary",
    ]
    return "\n".join(header).encode("ascii", "replace") + b"\n" + cloud.tobytes()


def _names(cloud: NDArray[np.void]) -> tuple[str, ...]:
    return cloud.dtype.names or ()


def _named(cloud: NDArray[np.void], frame: ExportFrame) -> list[tuple[int, str]]:
    """Return number and name of the regions in a cloud."""
    if "region" not in _names(cloud):
        return []
    numbers = np.unique(cloud["region"])
    return [(int(n), frame.region_names[int(n)]) for n in numbers if int(n) in frame.region_names]


POINT_CLOUDS = (
    Export(
        "ply",
        "point clouds: metres, normals, region, infrared",
        lambda f: ((f"_{name}.ply", encode_ply(point_cloud(f, name), f)) for name in f.depth_m),
    ),
    Export(
        "pcd",
        "the same for the Point Cloud Library",
        lambda f: ((f"_{name}.pcd", encode_pcd(point_cloud(f, name), f)) for name in f.depth_m),
    ),
)
