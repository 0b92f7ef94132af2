"""Each format's less usual forms are read as it defines them."""

import base64
import json
import struct
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from glsim.core.errors import MeshError
from glsim.faces.meshes.load import read_mesh
from tests.support.face_models import analytic_face

#: An arrow's head, a square beside it and a pentagon that is hollow at its last corner.
LOW = [(100, 0, 0), (30, 30, 0), (0, 100, 0), (0, 0, 0), (200, 0, 0), (200, 100, 0), (100, 100, 0)]
HIGH = [(300, 0, 5), (400, 0, 5), (400, 90, 5), (350, 30, 5), (300, 90, 5)]
POINTS = np.array([*LOW, *HIGH], dtype=np.float64)
POLYGONS = [[0, 1, 2, 3], [0, 4, 5, 6], [4, 5, 0], [7, 8, 9, 10, 11], [3, 4]]
AREA = 3000 + 10_000 + 5000 + 6000
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 1]], dtype=np.float32)
CORNERS = [0, 1, 2, 0, 2, 3]


def _area(path: Path) -> float:
    mesh = read_mesh(path)
    a, b, c = (mesh.vertices[mesh.faces[:, corner]] for corner in range(3))
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


def _ply(encoding: str, length: str = "uchar", index: str = "int", end: bytes = b"\n") -> bytes:
    """All polygons, with properties beside and behind the lists."""
    head = (
        f"ply\nformat {encoding} 1.0\ncomment c\nelement vertex 12\nproperty double x\n"
        "property uchar red\nproperty float y\nproperty float z\nproperty uchar green\n"
        f"property uchar blue\nelement face 5\nproperty list {length} {index} vertex_indices\n"
        "property list uchar float texcoord\nproperty short flags\nend_header\n"
    )
    codes = {"char": "b", "uchar": "B", "ushort": "H", "int": "i", "uint32": "I"}
    order, body = ">" if "big" in encoding else "<", b""
    for number, (x, y, z) in enumerate(POINTS):
        shade = 50 if number == 7 else 100
        row: tuple[Any, ...] = (x, shade, y, z, shade, shade)
        body += _row(order + "dBffBB", row, encoding)
    for number, corners in enumerate(POLYGONS):
        texture = number % 2 * 2
        kinds = f"{order}{codes[length]}{len(corners)}{codes[index]}B{texture}fh"
        body += _row(kinds, (len(corners), *corners, texture, *[0.5] * texture, -1), encoding)
    return head.encode().replace(b"\n", end) + body


def _row(kinds: str, values: tuple[Any, ...], encoding: str) -> bytes:
    if encoding == "ascii":
        return " ".join(str(value) for value in values).encode() + b"\n"
    return struct.pack(kinds, *values)


@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(("length", "index"), [("uchar", "int"), ("int", "ushort")])
@pytest.mark.parametrize("end", [b"\n", b"\r\n"])
def test_a_ply_may_mix_polygons(
    tmp_path: Path, encoding: str, length: str, index: str, end: bytes
) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(_ply(encoding, length, index, end))
    assert _area(path) == pytest.approx(AREA)
    mesh = read_mesh(path)
    np.testing.assert_array_equal(mesh.vertices, POINTS)
    assert mesh.albedo.tolist() == pytest.approx([0.6] * 7 + [0.3] + [0.6] * 4)
    path.write_bytes(_ply(encoding, length, index, end)[:-9])
    with pytest.raises(MeshError, match="cut short"):
        read_mesh(path)


def test_a_ply_of_strips(tmp_path: Path) -> None:
    strips = [0, 1, 3, 2, -1, 4, 5, 6]
    text = "ply\nformat ascii 1.0\nelement vertex 7\nproperty float x\nproperty float y\n"
    text += "property float z\nelement tristrips 1\nproperty list int int vertex_indices\n"
    rows = ["0 0 0", "1 0 0", "1 1 0", "0 1 0", "2 0 0", "3 0 0", "2 1 0"]
    text += "end_header\n" + "\n".join(rows) + f"\n8 {' '.join(map(str, strips))}\n"
    path = tmp_path / "a.ply"
    path.write_text(text)
    assert read_mesh(path).faces.tolist() == [[0, 1, 3], [2, 3, 1], [4, 5, 6]]


def test_an_off_may_mix_polygons_and_have_colours(tmp_path: Path) -> None:
    lines = [f"{x} {y} {z} {90 if n else 30} 90 90 255" for n, (x, y, z) in enumerate(POINTS)]
    faces = [f"{len(corners)} {' '.join(map(str, corners))} 0.1 0.2 0.3" for corners in POLYGONS]
    path = tmp_path / "a.off"
    text = "\r\n".join(["# c", "COFF # d", "12 5 0 # e", "", *lines, "# f", *faces])
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert _area(path) == pytest.approx(AREA)
    assert read_mesh(path).albedo[0] < 0.6
    path.write_text("OFF 12 5 0\n" + text.split("\r\n\r\n")[1].replace("\r", ""))
    assert _area(path) == pytest.approx(AREA)
    path.write_text("4OFF\n1 0 0\n0 0 0 1\n")
    with pytest.raises(MeshError, match="export it as PLY"):
        read_mesh(path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
def test_an_obj_may_have_comments_and_a_byte_order_mark(tmp_path: Path, encoding: str) -> None:
    rows = [f"v {x} {y} {z}{' 0.5 0.5 0.5' if n < 3 else ''} # {n}" for n, (x, y, z) in
            enumerate(POINTS)]  # fmt: skip
    faces = [f"f {' '.join(f'{c + 1}/1' for c in p)}# x" for p in POLYGONS if len(p) > 2]
    faces[1] = faces[1].replace(" 7/1# x", " \\\r\n7/1 # x")
    text = "\r\n".join([*rows, "# C:\\heads\\", "  # in", *faces])
    path = tmp_path / "a.obj"
    path.write_bytes(text.encode(encoding))
    assert _area(path) == pytest.approx(AREA)
    np.testing.assert_array_equal(read_mesh(path).vertices, POINTS)


@settings(max_examples=40)
@given(radii=st.lists(st.floats(1, 100), min_size=3, max_size=12), turn=st.integers(0, 2))
def test_the_area_of_any_star_is_kept(tmp_path: Path, radii: list[float], turn: int) -> None:
    """A polygon that is seen whole from the origin, in each of three planes and both windings."""
    angle = 2 * np.pi * np.arange(len(radii)) / len(radii)
    star = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1) * np.array(radii)[:, None]
    after = np.roll(star, -1, axis=0)
    area = (star[:, 0] * after[:, 1] - star[:, 1] * after[:, 0]).sum() / 2
    path = tmp_path / "star.obj"
    for points in (np.roll(star, turn, axis=1), np.roll(star[::-1], turn, axis=1)):
        text = "".join(f"v {x} {y} {z}\n" for x, y, z in points)
        path.write_text(text + f"f {' '.join(str(n + 1) for n in range(len(points)))}\n")
        assert _area(path) == pytest.approx(area)


def _gltf(path: Path, tree: dict[str, Any], *blobs: bytes) -> Path:
    """Write a GLB or glTF of one mesh; each blob is a buffer view. ``tree`` adds or replaces."""
    views, data = [], b""
    for blob in blobs:
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": len(blob)})
        data += blob + b"\0" * (-len(blob) % 4)
    primitive = {"attributes": {"POSITION": 0}, "indices": 1} | tree.pop("primitive", {})
    whole: dict[str, Any] = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]} | tree.pop("mesh", {})],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": [view | extra for view, extra in
                        zip(views, tree.pop("views", [{}] * len(views)), strict=True)],
    } | tree  # fmt: skip
    if path.suffix == ".gltf":
        whole["buffers"][0]["uri"] = "data:application/octet-stream;base64," + (
            base64.b64encode(data).decode()
        )
        path.write_text(json.dumps(whole), encoding="utf-8-sig")
        return path
    text = json.dumps(whole).encode()
    text += b" " * (-len(text) % 4)
    size = 28 + len(text) + len(data)
    path.write_bytes(
        struct.pack("<4s4I", b"glTF", 2, size, len(text), 0x4E4F534A)
        + text + struct.pack("<2I", len(data), 0x004E4942) + data
    )  # fmt: skip
    return path


def _accessor(
    view: int | None, count: int, kind: str = "VEC3", of: int = 5126, **more: Any
) -> dict:
    place = {} if view is None else {"bufferView": view}
    return {"componentType": of, "count": count, "type": kind, **place, **more}


INDICES = np.array(CORNERS, "<u2").tobytes()
PLAIN = [_accessor(0, 4), _accessor(1, 6, "SCALAR", 5123)]


@pytest.mark.parametrize("suffix", [".glb", ".gltf"])
@pytest.mark.parametrize("base", [True, False])
def test_sparse_accessors_are_read(tmp_path: Path, suffix: str, base: bool) -> None:
    sparse = {"count": 3, "indices": {"bufferView": 2, "componentType": 5121},
              "values": {"bufferView": 3}}  # fmt: skip
    accessors = [_accessor(0 if base else None, 4, sparse=sparse), PLAIN[1]]
    values = np.array([[5, 6, 7], [8, 9, 10], [1, 0, 1]], "<f4").tobytes()
    path = _gltf(tmp_path / f"a{suffix}", {"accessors": accessors}, (SQUARE + 2).tobytes(), INDICES,
                 bytes([1, 3, 2]), values)  # fmt: skip
    vertices = read_mesh(path).vertices
    np.testing.assert_array_equal(
        vertices, [SQUARE[0] + 2 * base, [5, 6, 7], [1, 0, 1], [8, 9, 10]]
    )


@pytest.mark.parametrize(
    ("of", "kind", "top"),
    [(5120, "i1", 127), (5121, "u1", 255), (5122, "<i2", 32767), (5123, "<u2", 65535)],
)
@pytest.mark.parametrize("normalized", [True, False])
def test_integers_are_positions(
    tmp_path: Path, of: int, kind: str, top: int, normalized: bool
) -> None:
    rows = np.zeros((4, 4), kind)
    rows[:, :3] = SQUARE * top
    accessors = [_accessor(0, 4, of=of, normalized=normalized), PLAIN[1]]
    tree = {"accessors": accessors, "extensionsRequired": ["KHR_mesh_quantization"],
            "views": [{"byteStride": rows.strides[0]}, {}]}  # fmt: skip
    tree["nodes"] = [{"mesh": 0, "scale": [1, 1, 1] if normalized else [1 / top] * 3}]
    path = _gltf(tmp_path / "a.glb", tree, rows.tobytes(), INDICES)
    np.testing.assert_allclose(read_mesh(path).vertices, SQUARE, atol=1e-12)


@pytest.mark.parametrize("where", ["mesh", "nodes"])
def test_default_weights_of_morph_targets_are_applied(tmp_path: Path, where: str) -> None:
    moves = np.array([[[0, 0, 2]] * 4, [[0, 4, 0]] * 4], "<f4")
    tree: dict[str, Any] = {
        "accessors": [*PLAIN, _accessor(2, 4), _accessor(3, 4)],
        "primitive": {"targets": [{"POSITION": 2}, {"POSITION": 3}]},
        "mesh": {"weights": [0.5, 0.0]},
    }
    if where == "nodes":
        tree["nodes"] = [{"mesh": 0, "weights": [0.0, 0.25]}]
    path = _gltf(tmp_path / "a.glb", tree, SQUARE.tobytes(), INDICES, *(m.tobytes() for m in moves))
    moved = [0, 1, 0] if where == "nodes" else [0, 0, 1]
    np.testing.assert_allclose(read_mesh(path).vertices, SQUARE + moved)


@pytest.mark.parametrize("bound", [True, False])
def test_skins_place_vertices_where_the_joints_are(tmp_path: Path, bound: bool) -> None:
    """Vertices 0 and 1 follow a turned joint, 2 one below a moved one, 3 both alike."""
    joints = np.array([[0, 0, 0, 0], [0, 0, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0]], "u1")
    weights = np.array([[1, 0, 0, 0]] * 3 + [[0.5, 0.5, 0, 0]], "<f4")
    inverse = np.stack([np.eye(4), np.eye(4)]).astype("<f4")
    inverse[1, 3, :3] = [-1, 0, 0]  # by columns
    tree = {
        "accessors": [*PLAIN, _accessor(2, 4, "VEC4", 5121), _accessor(3, 4, "VEC4"),
                      _accessor(4, 2, "MAT4")],
        "primitive": {"attributes": {"POSITION": 0, "JOINTS_0": 2, "WEIGHTS_0": 3}},
        "scenes": [{"nodes": [0, 1, 2]}],
        "nodes": [{"mesh": 0, "skin": 0, "translation": [9, 9, 9]},
                  {"rotation": [0, 0, 2**-0.5, 2**-0.5]},
                  {"translation": [0, 0, 3], "children": [3]}, {"scale": [2, 2, 2]}],
        "skins": [{"joints": [1, 3]} | ({"inverseBindMatrices": 4} if bound else {})],
    }  # fmt: skip
    blobs = (SQUARE.tobytes(), INDICES, joints.tobytes(), weights.tobytes(), inverse.tobytes())
    vertices = read_mesh(_gltf(tmp_path / "a.glb", tree, *blobs)).vertices
    turned = SQUARE[:, [1, 0, 2]] * [-1, 1, 1]
    scaled = 2 * (SQUARE - ([1, 0, 0] if bound else [0, 0, 0])) + [0, 0, 3]
    expected = np.stack([turned[0], turned[1], scaled[2], (turned[3] + scaled[3]) / 2])
    np.testing.assert_allclose(vertices, expected, atol=1e-6)


@pytest.mark.parametrize(("mode", "corners", "faces"), [
    (5, [0, 1, 3, 2], [[0, 1, 3], [2, 3, 1]]), (6, [0, 1, 2, 3], [[0, 1, 2], [0, 2, 3]])
])  # fmt: skip
def test_strips_and_fans_below_a_tree_of_nodes(
    tmp_path: Path, mode: int, corners: list[int], faces: list[list[int]]
) -> None:
    matrix = np.diag([2.0, 2, 2, 1])
    matrix[:3, 3] = 1, 2, 3
    tree = {
        "accessors": [PLAIN[0], _accessor(1, 4, "SCALAR", 5121)], "primitive": {"mode": mode},
        "nodes": [{"children": [1], "matrix": matrix.T.ravel().tolist()},
                  {"mesh": 0, "scale": [1, 1, -1]}, {"mesh": 0}],
    }  # fmt: skip
    mesh = read_mesh(_gltf(tmp_path / "a.glb", tree, SQUARE.tobytes(), bytes(corners)))
    np.testing.assert_allclose(mesh.vertices, SQUARE * [2, 2, -2] + [1, 2, 3])
    assert mesh.faces.tolist() == [face[::-1] for face in faces]  # a mirror


def test_materials_and_vertex_colours_multiply(tmp_path: Path) -> None:
    shades = np.array([[255] * 4, [255] * 4, [255] * 4, [51] * 4], "u1")
    material = {"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.5, 0.5, 1]}}
    tree = {
        "accessors": [*PLAIN, _accessor(2, 4, "VEC4", 5121, normalized=True)],
        "primitive": {"attributes": {"POSITION": 0, "COLOR_0": 2}, "material": 0},
        "materials": [material],
    }
    blobs = (SQUARE.tobytes(), INDICES, shades.tobytes())
    mesh = read_mesh(_gltf(tmp_path / "a.glb", tree.copy(), *blobs))
    assert mesh.albedo.tolist() == pytest.approx([0.6, 0.6, 0.6, 0.12])


@pytest.mark.parametrize("name", ["EXT_meshopt_compression", "KHR_meshopt_compression", "X_y"])
def test_required_extensions_that_are_not_read_are_named(tmp_path: Path, name: str) -> None:
    tree = {"accessors": PLAIN, "extensionsRequired": ["KHR_materials_unlit", name]}
    path = _gltf(tmp_path / "a.glb", tree.copy(), SQUARE.tobytes(), INDICES)
    with pytest.raises(MeshError, match=f"needs the glTF extension {name}, which"):
        read_mesh(path)
    tree["extensionsRequired"] = ["KHR_materials_unlit", "KHR_texture_transform"]
    assert len(read_mesh(_gltf(path, tree, SQUARE.tobytes(), INDICES)).faces) == 2


def test_draco_is_decoded_or_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    vertices, faces = analytic_face(rows=9, columns=9)
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    path = tmp_path / "a.glb"
    path.write_bytes(mesh.export(file_type="glb", extension_draco=True))
    assert b"KHR_draco" in path.read_bytes()
    loaded = read_mesh(path)
    assert len(loaded.faces) == len(faces)
    np.testing.assert_allclose(np.ptp(loaded.vertices, axis=0), np.ptp(vertices, axis=0), atol=0.1)
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    with pytest.raises(MeshError, match="needs DracoPy for the glTF extension KHR_draco"):
        read_mesh(path)


CORNER_OBJ = "v 0 0 0\nv 9 0 0\nv 9 9 0\nv 0 9 0\nusemtl skin\nf 1 2 3\nusemtl eye\nf 3 4 1\n"


@pytest.mark.parametrize(
    ("line", "missing"),
    [
        ("a.mtl b.mtl", ""),
        ("'a.mtl' \"b.mtl\"", ""),
        ("my colours.mtl", ""),
        ("C:\\work\\MY Colours.MTL", ""),
        ("a.mtl sub/B.MTL", ""),
        ("a.mtl none.mtl", "none.mtl"),
        ("../a.mtl ../../x/b.mtl", ""),
        ("none here.mtl", "none here.mtl"),
    ],
)
def test_all_material_files_are_found_or_named(tmp_path: Path, line: str, missing: str) -> None:
    skin, eye = "newmtl skin\nKd 0.8 0.8 0.8\n", "newmtl eye\nKd 0.2 0.2 0.2\n"
    (tmp_path / "sub").mkdir()
    texts = {"a": skin, "b": eye, "sub/b": eye, "my colours": skin + eye}
    for name, text in texts.items():
        (tmp_path / f"{name}.mtl").write_text(text)
    (tmp_path / "m.obj").write_text(f"mtllib {line}\n{CORNER_OBJ}")
    mesh = read_mesh(tmp_path / "m.obj")
    assert (mesh.albedo is None) == bool(missing)
    said = f"{missing} of its mtllib is not found: no albedo"
    assert mesh.doubts == ((said,) if missing else ())


@pytest.mark.parametrize("word", ["-nan(ind)", "-1.#IND", "1.#QNAN0", "nan", "-nan"])
def test_values_that_are_not_used_may_be_no_numbers(tmp_path: Path, word: str) -> None:
    head = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
    head += "property float z\nproperty float nx\nelement face 1\n"
    path = tmp_path / "a.ply"
    path.write_text(
        f"{head}property list uchar int vertex_index\nend_header\n"
        f"0 0 0 {word}\n1 0 0 {word}\n0 1 0 0\n3 0 1 2\n"
    )
    assert len(read_mesh(path).faces) == 1
    path = tmp_path / "a.obj"
    path.write_text(f"v 0 0 0 {word} 1 1\nv 1 0 0 1 1 1\nv 0 1 0 1 1 1\nvn {word} 0 0\nf 1 2 3\n")
    assert len(read_mesh(path).faces) == 1
    path.write_text(f"v {word} 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(MeshError, match="have a vertex at NaN or infinity"):
        read_mesh(path)


def test_an_ascii_ply_may_hold_more_than_its_header_declares(tmp_path: Path) -> None:
    path, text = tmp_path / "a.ply", _ply("ascii").decode()
    path.write_text(text.replace(" -1\n", " -1 9 1 1 1 0 0 0 1 1 1\n"))
    assert _area(path) == pytest.approx(AREA)
    path.write_text(text.replace(" -1\n", " -1 9 1\n", 1).replace("5 7 8 9 10 11", "7 7 8 9"))
    with pytest.raises(MeshError, match=r"line 31, of element 'face', has 8 numbers .* 10"):
        read_mesh(path)


def test_small_faults_of_polygons_lose_no_triangle(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v -5 0 5\nv 5 0 5\nv 5 0 -5\nv -5 0 -5\nv 0 5 -5\nf 1 2 3 4 5\n")
    assert len(read_mesh(path).faces) == 3  # its last corner lies outside the plane of the others
    path.write_text("v 0 0 0\nv 5 0 0\nv 5 5 0\nv 0 5 0\nf 1 2\nf 1 2 3\nf 3\nf 1 3 4\n")
    mesh = read_mesh(path)
    assert (len(mesh.faces), mesh.degenerate) == (2, 0)


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
@pytest.mark.parametrize("lost", [20, 60, 90])
def test_an_stl_cut_short_says_so(tmp_path: Path, kind: str, lost: int) -> None:
    data = trimesh.Trimesh(SQUARE, [CORNERS[:3], CORNERS[3:]]).export(file_type=kind)
    path = tmp_path / "a.stl"
    path.write_bytes((data.encode() if isinstance(data, str) else data)[: -lost - 10])
    with pytest.raises(MeshError, match="cut short"):
        read_mesh(path)
