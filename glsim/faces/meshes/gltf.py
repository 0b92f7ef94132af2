"""Read the triangles of a glTF 2.0 file as its default scene shows them.

trimesh does not read sparse accessors, morph targets, skins and normalised integers.
"""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import MeshError, pip_install
from glsim.core.files.regular import open_regular
from glsim.core.products import product
from glsim.faces.meshes.obj import MAX_BYTES, check_corners, check_count, check_start, read_bytes

_Array = NDArray[Any]

#: ``componentType`` -> NumPy's type; ``type`` -> numbers in an element.
_TYPES: Final = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS: Final = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

#: Properties of a node that place it.
_PLACES: Final = {"matrix", "rotation", "scale", "translation"}
#: Largest number of objects, lists and their entries in the JSON: they take 60 MB.
_MOST_ENTRIES: Final = 500_000
#: Largest number of coordinates, indices and colours that are made besides one for each byte of the
#: buffers, as copies and as zeros: they take 60 MB. Each part counts as _EACH numbers more.
_MOST_COPIES, _EACH = 1 << 20, 64

_DRACO: Final = "KHR_draco_mesh_compression"
#: Extensions that are read, or that leave the surface as it is.
_KNOWN: Final = re.compile(
    rf"KHR_mesh_quantization|{_DRACO}|KHR_lights_\w+|KHR_xmp\w*|\w+_(materials|texture)_\w+"
)


def read_gltf(path: Path) -> list[tuple[_Array, _Array, _Array | None]]:
    """Return vertices (V, 3), triangles (F, 3), and colours (V, 3) or None, of each primitive.

    Raises MeshError, or the parser's error for a damaged file.
    """
    head = check_start(path, rb"\s*\{[^\0]*\Z|glTF.{16}", "glTF")
    packed = head.startswith(b"glTF")
    promised = int.from_bytes(head[8:12], "little") if packed else MAX_BYTES
    data = read_bytes(path, promised + 4096)  # some writers pad the end
    chunk = b""
    if packed:
        if len(data) < promised:
            raise MeshError(f"{path}: cut short: it has {len(data)} bytes of those it promises")
        size = int.from_bytes(data[12:16], "little")
        chunk, data = data[28 + size :], data[20 : 20 + size]
    if sum(data.count(mark) for mark in (b"{", b"[", b",")) > _MOST_ENTRIES:
        raise MeshError(f"{path}: its JSON has more than {_MOST_ENTRIES} entries; export it again")
    tree = json.loads(data)
    if not str(tree.get("asset", {}).get("version", "2")).startswith("2"):
        raise MeshError(f"{path}: is not glTF 2; export it as glTF 2")
    unknown = [name for name in tree.get("extensionsRequired", ()) if not _KNOWN.fullmatch(name)]
    if unknown:
        raise MeshError(
            f"{path}: needs the glTF extension {', '.join(unknown)}, which glsim does not read; "
            "export it without"
        )
    return _Scene(path, tree, chunk).parts()


class _Scene:
    """A glTF file: its JSON, its buffers, and the binary chunk of a GLB."""

    def __init__(self, path: Path, tree: dict[str, Any], chunk: bytes) -> None:
        self._path, self._tree = path, tree
        self._decoded: dict[int, _Array] = {}
        self._chunk, self._files = chunk, dict[str, bytes]()
        self._left = _MOST_COPIES + len(chunk)

    def parts(self) -> list[tuple[_Array, _Array, _Array | None]]:
        nodes = self._tree.get("nodes", [])
        children = {child for node in nodes for child in node.get("children", ())}
        roots = [number for number in range(len(nodes)) if number not in children]
        self._places = self._placed(roots)
        scenes = self._tree.get("scenes") or [{"nodes": roots}]
        shown = self._placed(scenes[self._tree.get("scene", 0)].get("nodes", ()))
        parts, triangles = [], 0
        for number, place in shown.items():
            mesh = self._tree["meshes"][nodes[number]["mesh"]] if "mesh" in nodes[number] else {}
            for primitive in mesh.get("primitives", ()):
                if primitive.get("mode", 4) >= 4:  # others are points and lines
                    parts.append(self._part(nodes[number], mesh, primitive, place))
                    triangles += len(parts[-1][1])
                    check_count(self._path, triangles)
        return parts

    def _spend(self, numbers: int) -> None:
        """Count numbers that are read, again for each copy. Raises MeshError for too many."""
        self._left -= numbers
        if self._left < 0:
            raise MeshError(
                f"{self._path}: its nodes show the same data too often; export it as one mesh"
            )

    def _placed(self, roots: Iterable[int]) -> dict[int, _Array]:
        """Return the (4, 4) matrix of each node below the roots."""
        from trimesh.transformations import quaternion_matrix  # takes 0.2 s to import

        places: dict[int, _Array] = {}
        still = np.eye(4)
        left = [(root, still) for root in reversed(list(roots))]
        while left:
            number, above = left.pop()
            if number in places:
                continue
            node = self._tree["nodes"][number]
            if _PLACES.isdisjoint(node):
                local = still
            elif "matrix" in node:
                local = np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
            else:
                x, y, z, w = node.get("rotation", (0, 0, 0, 1))
                local = np.asarray(quaternion_matrix((w, x, y, z)))  # type: ignore[no-untyped-call]
                local[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
                local[:3, 3] = node.get("translation", (0, 0, 0))
            places[number] = above if local is still else product(above, local)
            left += [(child, places[number]) for child in reversed(node.get("children", ()))]
        return places

    def _part(
        self, node: dict[str, Any], mesh: dict[str, Any], primitive: dict[str, Any], place: _Array
    ) -> tuple[_Array, _Array, _Array | None]:
        names, mode = primitive["attributes"], primitive.get("mode", 4)
        draco = primitive.get("extensions", {}).get(_DRACO)
        if draco and "bufferView" not in self._tree["accessors"][names["POSITION"]]:
            self._decode(primitive, draco)
            mode = 4
        vertices = self._values(names["POSITION"])
        weights = node.get("weights") or mesh.get("weights") or ()
        for weight, target in zip(weights, primitive.get("targets", ()), strict=False):
            if weight and "POSITION" in target:
                vertices = vertices + weight * self._values(target["POSITION"])
        corners = np.arange(len(vertices))
        if "indices" in primitive:
            corners = self._raw(primitive["indices"]).ravel().astype(np.int64)
        check_corners(self._path, corners, len(vertices))
        self._spend(0 if mode == 4 else 2 * len(corners))
        if mode == 4:
            faces = corners[: len(corners) // 3 * 3].reshape(-1, 3)
        else:
            first = corners[:-2] if mode == 5 else np.full(max(len(corners) - 2, 0), corners[0])
            faces = np.stack([first, corners[1:-1], corners[2:]], axis=1)
            if mode == 5:
                faces[1::2] = faces[1::2, ::-1]
        if "skin" in node and "JOINTS_0" in names:
            vertices = self._skinned(vertices, self._tree["skins"][node["skin"]], names)
        else:
            vertices = product(vertices, place[:3, :3].T) + place[:3, 3]
            if np.linalg.det(place[:3, :3]) < 0:  # a mirror turns triangles round
                faces = faces[:, ::-1]
        return vertices, faces, self._colours(primitive)

    def _skinned(
        self, vertices: _Array, skin: dict[str, Any], names: dict[str, int]
    ) -> NDArray[np.float64]:
        """Return the vertices moved by the joints; the matrix of the mesh's node does not count."""
        self._spend(16 * len(skin["joints"]))
        joints = np.stack([self._places[number] for number in skin["joints"]])
        if "inverseBindMatrices" in skin:
            inverse = self._values(skin["inverseBindMatrices"]).reshape(-1, 4, 4)
            joints = (joints[:, :, None] * inverse[: len(joints), None]).sum(axis=3)
        moved, total = np.zeros_like(vertices), np.full((len(vertices), 1), 1e-12)
        for name in (name for name in names if name.startswith("JOINTS_")):
            weights = self._values(names[name.replace("JOINTS", "WEIGHTS")])
            for joint, weight in zip(self._raw(names[name]).T, weights.T[..., None], strict=True):
                matrix = joints[joint, :3]
                placed = (matrix[:, :, :3] * vertices[:, None]).sum(axis=2) + matrix[:, :, 3]
                moved += weight * placed
                total += weight
        return np.asarray(moved / total)

    def _colours(self, primitive: dict[str, Any]) -> _Array | None:
        """Return (V, 3) RGB from vertex colours and an untextured material; None without."""
        names = primitive["attributes"]
        colours = self._values(names["COLOR_0"])[:, :3] if "COLOR_0" in names else None
        if "material" not in primitive:
            return colours
        material = self._tree["materials"][primitive["material"]]
        glossy = material.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness")
        look = glossy or material.get("pbrMetallicRoughness", {})
        if "diffuseTexture" in look or "baseColorTexture" in look:
            return None
        factor = look.get("diffuseFactor") or look.get("baseColorFactor") or (1.0, 1.0, 1.0)
        if colours is None:
            colours = np.ones((len(self._raw(names["POSITION"])), 3))
        return np.asarray(colours * np.array(factor[:3]))

    def _decode(self, primitive: dict[str, Any], draco: dict[str, Any]) -> None:
        """Decode the accessors of a primitive. Raises MeshError."""
        try:
            import DracoPy

            mesh = DracoPy.decode(bytes(self._view(draco["bufferView"])))
            data = {attribute["unique_id"]: attribute["data"] for attribute in mesh.attributes}
            for name, number in draco["attributes"].items():
                self._decoded[primitive["attributes"][name]] = data[number]
            self._decoded[primitive["indices"]] = mesh.faces
        except ImportError:
            raise MeshError(
                f"{self._path}: needs DracoPy for the glTF extension {_DRACO}: "
                f"{pip_install('formats')}, or export it without"
            ) from None
        except Exception as error:  # of any type
            raise MeshError(
                f"{self._path}: its {_DRACO} cannot be decoded ({error!r:.80}); export it without"
            ) from None

    def _values(self, index: int) -> NDArray[np.float64]:
        """Return an accessor's (N, K) numbers; normalised integers are -1 to 1."""
        entry = self._tree["accessors"][index]
        values = self._raw(index).astype(np.float64)
        if entry.get("normalized") and entry["componentType"] != 5126:
            values = np.maximum(values / np.iinfo(_TYPES[entry["componentType"]]).max, -1.0)
        return values

    def _raw(self, index: int) -> _Array:
        """Return an accessor's (N, K) numbers as they are stored."""
        self._spend(_EACH)
        if index in self._decoded:
            self._spend(self._decoded[index].size)
            return self._decoded[index]
        entry = self._tree["accessors"][index]
        values = self._stored(entry)
        if sparse := entry.get("sparse"):
            number = {"count": sparse["count"]}
            changed = self._stored({**sparse["indices"], **number, "type": "SCALAR"})
            values = values.copy()
            values[changed[:, 0]] = self._stored(
                {**entry, "byteOffset": 0, **sparse["values"], **number}
            )
        return values

    def _stored(self, entry: dict[str, Any]) -> _Array:
        """Return the (N, K) numbers of a buffer view, whose rows may lie apart; zeros without."""
        kind, width = np.dtype(_TYPES[entry["componentType"]]), _WIDTHS[entry["type"]]
        self._spend(width * entry["count"])
        if "bufferView" not in entry:
            return np.zeros((entry["count"], width), kind)
        apart = self._tree["bufferViews"][entry["bufferView"]].get("byteStride")
        strides = (max(apart or 0, kind.itemsize * width), kind.itemsize)
        data = self._view(entry["bufferView"])
        return np.ndarray((entry["count"], width), kind, data, entry.get("byteOffset", 0), strides)

    def _view(self, index: int) -> memoryview:
        view = self._tree["bufferViews"][index]
        start, length = view.get("byteOffset", 0), view["byteLength"]
        data = memoryview(self._buffer(view["buffer"]))[start : start + length]
        if len(data) < length:
            raise ValueError(f"buffer {view['buffer']} is cut short")
        return data

    def _buffer(self, index: int) -> bytes:
        entry = self._tree["buffers"][index]
        if (uri := entry.get("uri")) is None:
            return self._chunk
        if uri in self._files:
            return self._files[uri]
        if uri.startswith("data:"):
            data = base64.b64decode(uri.partition(",")[2])
        else:
            folder = self._path.parent
            try:
                with open_regular(folder / unquote(uri), MAX_BYTES, inside=folder) as file:
                    data = file.read(entry["byteLength"])
            except OSError as error:
                reason = error.strerror or error
                raise MeshError(f"{self._path}: its buffer {uri}: {reason}") from None
        self._files[uri] = data
        self._left += len(data)
        return data
