"""Check a glTF or GLB file before trimesh reads it, and give it only what a mesh needs.

A glTF file is a JSON tree that points into buffers. A small tree can promise a lot: one mesh in
3,000 nodes, one buffer cut into 10,000 overlapping views, a number of zeros without any buffer, a
buffer that is another file. All of it is counted here first. Textures are not read: glsim takes no
albedo from them, and a picture may be a bomb of its own.

glTF 2.0 specification, The Khronos Group, version 2.0.1.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

from glsim.errors import MeshError
from glsim.files.regular import read_regular
from glsim.meshio.limits import MAX_BYTES, MAX_TRIANGLES, check_count

#: Most nodes of a scene, and most nodes above one: far more than one person's head needs; the
#: transform of a node is a product over all nodes above it.
_MAX_NODES: Final = 10_000
_MAX_DEPTH: Final = 64
#: Most values of a tree; a value takes some hundred bytes in memory, and one byte in the file.
_MAX_VALUES: Final = 1_000_000
#: Views may overlap, and accessors may share a view, but not many times over.
_OVERLAP: Final = 4
_SPARE_BYTES: Final = 1 << 24

_GLB_HEAD: Final = struct.Struct("<4sII")
_CHUNK_HEAD: Final = struct.Struct("<I4s")
_COMPONENT_BYTES: Final = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
_COMPONENTS: Final = {
    "SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16,
}  # fmt: skip
_TEXTURED: Final = ("baseColorTexture", "metallicRoughnessTexture")


def prepare_gltf(path: Path, data: bytes) -> tuple[bytes, dict[str, bytes]]:
    """Return the file without its textures, and the contents of the files that it names.

    Raises MeshError for a tree that promises too much or names a file outside of its folder, and
    other exceptions (KeyError, TypeError, ValueError, ...) for a damaged one.
    """
    if path.suffix.lower() == ".gltf":
        text, rest = data, b""
    else:
        text, rest = _split_glb(data)
    values = sum(text.count(mark) for mark in (b"{", b"[", b","))
    if values > _MAX_VALUES:
        raise MeshError(f"{path}: {values} values in its tree, the limit is {_MAX_VALUES}")
    tree = json.loads(text)
    files = _named_buffers(path, tree)
    _check_sizes(path, tree, len(data) + sum(map(len, files.values())))
    _check_scene(path, tree)
    _drop_textures(tree)
    text = json.dumps(tree).encode()
    if path.suffix.lower() == ".gltf":
        return text, files
    text += b" " * (-len(text) % 4)
    whole = _CHUNK_HEAD.pack(len(text), b"JSON") + text + rest
    return _GLB_HEAD.pack(b"glTF", 2, _GLB_HEAD.size + len(whole)) + whole, files


def _split_glb(data: bytes) -> tuple[bytes, bytes]:
    """Return the text of the tree of a GLB file, and the bytes of its other chunks."""
    magic, version, size = _GLB_HEAD.unpack_from(data)
    if magic != b"glTF" or version != 2:
        raise ValueError("no GLB file of version 2")
    if size > len(data):
        raise ValueError(f"{size} bytes are promised, {len(data)} are there")
    length, kind = _CHUNK_HEAD.unpack_from(data, _GLB_HEAD.size)
    start = _GLB_HEAD.size + _CHUNK_HEAD.size
    if kind != b"JSON" or start + length > len(data):
        raise ValueError("its first part is not the JSON tree")
    return data[start : start + length], data[start + length :]


def _named_buffers(path: Path, tree: Mapping[str, Any]) -> dict[str, bytes]:
    """Read the buffers that are files beside the tree. Raises MeshError."""
    files: dict[str, bytes] = {}
    for buffer in tree.get("buffers", []):
        uri = buffer.get("uri")
        if uri is None or "base64," in uri or uri in files:
            continue
        name = unquote(uri)
        try:
            if "://" in name or name.startswith("/"):
                raise OSError(0, f"is no file in the folder {path.parent}")
            left = MAX_BYTES - sum(map(len, files.values()))
            files[uri] = read_regular(path.parent / name, left, inside=path.parent)
        except OSError as error:
            raise MeshError(
                f"{path}: its buffer {name!a:.80} cannot be read: {error.strerror}"
            ) from None
    return files


def _check_sizes(path: Path, tree: Mapping[str, Any], file_bytes: int) -> None:
    """Compare what the views and accessors take in memory with the bytes that there are."""
    views = sum(_count(view["byteLength"]) for view in tree.get("bufferViews", []))
    accessors = 0
    for accessor in tree.get("accessors", []):
        size = _COMPONENT_BYTES[accessor["componentType"]] * _COMPONENTS[accessor["type"]]
        accessors += size * _count(accessor["count"])
    if max(views, accessors) > _OVERLAP * file_bytes + _SPARE_BYTES:
        raise MeshError(
            f"{path}: promises {max(views, accessors) / 1e6:.0f} MB of numbers in "
            f"{file_bytes / 1e6:.1f} MB of files; it is damaged, export it again"
        )


def _check_scene(path: Path, tree: Mapping[str, Any]) -> None:
    """Count the triangles and vertices of all nodes; a mesh counts once per node that shows it."""
    meshes = [_mesh_size(tree, mesh) for mesh in tree.get("meshes", [])]
    nodes: Sequence[Any] = tree.get("nodes", [])
    if len(nodes) > _MAX_NODES:
        raise MeshError(f"{path}: {len(nodes)} nodes, the limit is {_MAX_NODES}; join its meshes")
    check_count(path, sum(meshes))
    check_count(path, sum(meshes[node["mesh"]] for node in nodes if "mesh" in node))
    parents: dict[int, int] = {}
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            if child in parents:
                raise MeshError(f"{path}: node {child} has two parents; export it again")
            parents[child] = number
    for number in range(len(nodes)):
        depth, place = 0, number
        while place in parents:
            place, depth = parents[place], depth + 1
            if depth > _MAX_DEPTH:
                raise MeshError(
                    f"{path}: node {number} has more than {_MAX_DEPTH} nodes above it, or is its "
                    "own parent; export it again"
                )


def _mesh_size(tree: Mapping[str, Any], mesh: Mapping[str, Any]) -> int:
    """Return the triangles or the vertices of a mesh, whichever are more."""
    accessors = tree["accessors"]
    triangles = vertices = 0
    for primitive in mesh["primitives"]:
        points = _count(accessors[primitive["attributes"]["POSITION"]]["count"])
        corners = points
        if "indices" in primitive:
            corners = _count(accessors[primitive["indices"]]["count"])
        strip = primitive.get("mode", 4) != 4
        triangles += corners if strip else corners // 3
        vertices += points
    return min(max(triangles, vertices), 1000 * MAX_TRIANGLES)


def _drop_textures(tree: dict[str, Any]) -> None:
    """Remove pictures; a textured material goes too, since its colour alone means nothing."""
    textured = {
        number
        for number, material in enumerate(tree.get("materials", []))
        if any(name in material.get("pbrMetallicRoughness", {}) for name in _TEXTURED)
    }
    for mesh in tree.get("meshes", []):
        for primitive in mesh["primitives"]:
            if primitive.get("material") in textured:
                del primitive["material"]
    for material in tree.get("materials", []):
        for name in [name for name in material if name.endswith("Texture")]:
            del material[name]
        for name in _TEXTURED:
            material.get("pbrMetallicRoughness", {}).pop(name, None)
    for name in ("images", "textures", "samplers", "animations", "skins"):
        tree.pop(name, None)


def _count(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or value < 0:
        raise ValueError(f"{value!r:.40} is no count")
    return value
