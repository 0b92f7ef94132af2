"""A small head in every format of meshes, written without a library."""

from __future__ import annotations

import base64
import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from tests.support import mutations
from tests.support.face_sets import obj_bytes, ply_bytes


def write_mesh(path: Path, *, ascii: bool = False) -> None:
    """Write a small head as a mesh file; the suffix of the name is the format."""
    points, quads, triangles = mutations._small()
    suffix = path.suffix
    if suffix == ".obj":
        material = b"mtllib face.mtl\nusemtl skin\n"
        path.with_suffix(".mtl").write_text("newmtl skin\nKd 0.8 0.6 0.5\n")
        path.write_bytes(material + obj_bytes(points, quads, "/1/1"))
    elif suffix == ".ply":
        write = mutations._ascii_ply if ascii else ply_bytes
        path.write_bytes(write(points, triangles))
    elif suffix == ".off":
        lines = [f"OFF\n{len(points)} {len(triangles)} 0"]
        lines += [" ".join(f"{value:.5g}" for value in point) for point in points]
        lines += [f"3 {a} {b} {c}" for a, b, c in triangles]
        path.write_text("\n".join(lines) + "\n")
    elif suffix == ".stl":
        facets = np.zeros(
            len(triangles), [("normal", "<f4", 3), ("points", "<f4", (3, 3)), ("spare", "<u2")]
        )
        facets["points"] = points[triangles]
        path.write_bytes(bytes(80) + struct.pack("<I", len(facets)) + facets.tobytes())
    else:
        _write_gltf(path, points, triangles)


def _write_gltf(path: Path, points: np.ndarray, triangles: np.ndarray) -> None:
    buffer = points.astype("<f4").tobytes() + triangles.astype("<u4").tobytes()
    size = points.astype("<f4").nbytes
    uri = "data:application/octet-stream;base64," + base64.b64encode(buffer).decode()
    inside = path.suffix == ".gltf"
    tree: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1], "translation": [0, 0, 0.1]}, {"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": {"baseColorFactor": [1, 0.5, 0.4, 1]}}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": triangles.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": size},
            {"buffer": 0, "byteOffset": size, "byteLength": len(buffer) - size},
        ],
        "buffers": [{"byteLength": len(buffer)} | ({"uri": uri} if inside else {})],
    }
    text = json.dumps(tree).encode()
    if inside:
        path.write_bytes(text)
        return
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(buffer), b"BIN\0") + buffer
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
