"""Small files that promise a lot, files that never end, and names that lead elsewhere."""

from __future__ import annotations

import base64
import json
import os
import resource
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glsim.errors import MeshError
from glsim.meshio import gltf, limits
from glsim.meshio.load import read_mesh
from glsim.meshio.obj import read_obj
from tests.support.face_models import analytic_face

POINTS, TRIANGLES = analytic_face(rows=31, columns=25)
OBJ = "".join(f"v {x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in POINTS) + "".join(
    f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in TRIANGLES
)
BUFFER = POINTS.astype("<f4").tobytes() + TRIANGLES.astype("<u4").tobytes()


def tree(**changes: Any) -> dict[str, Any]:
    """A glTF tree of the analytic face, with its buffer inside."""
    points = POINTS.astype("<f4").nbytes
    views = [{"buffer": 0, "byteOffset": 0, "byteLength": points}]
    views.append({"buffer": 0, "byteOffset": points, "byteLength": len(BUFFER) - points})
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": len(POINTS), "type": "VEC3"},
        {"bufferView": 1, "componentType": 5125, "count": TRIANGLES.size, "type": "SCALAR"},
    ]
    uri = "data:application/octet-stream;base64," + base64.b64encode(BUFFER).decode()
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    whole: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(BUFFER), "uri": uri}],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [{"primitives": [primitive]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }
    return whole | changes


def write_gltf(path: Path, content: dict[str, Any]) -> Path:
    path.write_text(json.dumps(content))
    return path


def write_glb(path: Path, content: dict[str, Any]) -> Path:
    content = content | {"buffers": [{"byteLength": len(BUFFER)}]}
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    body = struct.pack("<I4s", len(text), b"JSON") + text
    body += struct.pack("<I4s", len(BUFFER), b"BIN\0") + BUFFER
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)
    return path


def refused(path: Path, limit_mb: int = 150) -> str:
    """The one-line error of a mesh, which takes little memory."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(MeshError) as error:
        read_mesh(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 1000 * limit_mb
    assert "\n" not in str(error.value)
    return str(error.value)


@pytest.mark.parametrize("write", [write_gltf, write_glb])
def test_the_plain_file_is_read(tmp_path: Path, write: Callable[..., Path]) -> None:
    suffix = write.__name__[6:]
    mesh = read_mesh(write(tmp_path / f"face.{suffix}", tree()))
    np.testing.assert_allclose(mesh.vertices, POINTS, atol=1e-4)
    np.testing.assert_array_equal(mesh.faces, TRIANGLES)
    twice = tree(nodes=[{"mesh": 0}, {"mesh": 0, "translation": [300, 0, 0]}])
    twice["scenes"] = [{"nodes": [0, 1]}]
    assert len(read_mesh(write(tmp_path / f"two.{suffix}", twice)).faces) == 2 * len(TRIANGLES)


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({"nodes": [{"mesh": 0}] * 5000}, "7200000 triangles or vertices, the limit is 5000000"),
        ({"nodes": [{"mesh": 0}] * 20_000}, "20000 nodes, the limit is 10000"),
        ({"meshes": tree()["meshes"] * 5000}, "triangles or vertices, the limit"),
        ({"bufferViews": tree()["bufferViews"] * 5000}, "MB of numbers in"),
        ({"accessors": tree()["accessors"] * 5000}, "MB of numbers in"),
        (
            {"accessors": [{"componentType": 5126, "count": 10**9, "type": "VEC3"}]},
            "12000 MB of numbers",
        ),
        ({"nodes": [{"children": [1]}, {"children": [0], "mesh": 0}]}, "is its own parent"),
        ({"nodes": [{"children": [2]}, {"children": [2]}, {"mesh": 0}]}, "has two parents"),
        ({"nodes": [{"children": [n + 1]} for n in range(99)] + [{"mesh": 0}]}, "nodes above it"),
        ({"accessors": [{"componentType": 5126, "count": -1, "type": "VEC3"}]}, "damaged"),
        ({"nodes": [{"mesh": 7}]}, "damaged"),
        ({"bufferViews": 3}, "damaged"),
        ({"extras": [[]] * 3_000_000}, "values in its tree"),
    ],
)
@pytest.mark.parametrize("write", [write_gltf, write_glb])
def test_a_tree_that_promises_too_much(
    tmp_path: Path, changes: dict[str, Any], problem: str, write: Callable[..., Path]
) -> None:
    """A GLB of 3 MB with one mesh in 3,000 nodes took 6.3 GB."""
    path = write(tmp_path / f"bomb.{write.__name__[6:]}", tree(**changes))
    assert problem in refused(path)


@pytest.mark.parametrize(
    ("uri", "problem"),
    [
        ("../secret.bin", "leads out of"),
        ("%2e%2e/secret.bin", "leads out of"),
        ("/dev/zero", "is no file in the folder"),
        ("file:///etc/passwd", "is no file in the folder"),
        ("link.bin", "leads out of"),
        ("pipe.bin", "is a pipe"),
        ("huge.bin", "MB are more than"),
        ("a%00b", "NUL byte"),
        (".", "leads out of|Is a directory"),
        ("none.bin", "No such file"),
    ],
)
def test_buffers_are_regular_files_in_the_folder(tmp_path: Path, uri: str, problem: str) -> None:
    """Before trimesh 5 a buffer of ../../secret.bin was read; a pipe waited for ever."""
    folder = tmp_path / "mesh"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(BUFFER)
    (folder / "own data.bin").write_bytes(BUFFER)
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    os.mkfifo(folder / "pipe.bin")
    with (folder / "huge.bin").open("wb") as file:
        file.truncate(20 << 30)
    buffer = {"byteLength": len(BUFFER), "uri": uri}
    message = refused(write_gltf(folder / "face.gltf", tree(buffers=[buffer])))
    assert any(part in message for part in problem.split("|"))
    buffer["uri"] = "own%20data.bin"
    assert len(read_mesh(write_gltf(folder / "face.gltf", tree(buffers=[buffer]))).faces) > 100


def test_textures_are_not_read(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "skin.png")
    content = tree(
        images=[{"uri": "skin.png"}, {"uri": "../out.png"}],
        textures=[{"source": 0}],
        materials=[{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}],
    )
    content["meshes"][0]["primitives"][0]["material"] = 0
    assert read_mesh(write_gltf(tmp_path / "face.gltf", content)).albedo is None
    ply = "ply\nformat ascii 1.0\ncomment TextureFile skin.png\nelement vertex 3\n"
    ply += "property float x\nproperty float y\nproperty float z\nelement face 1\n"
    ply += "property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
    (tmp_path / "face.ply").write_text(ply)
    assert len(read_mesh(tmp_path / "face.ply").faces) == 1


def test_material_files_are_small_regular_files(tmp_path: Path) -> None:
    """A pipe as a material file waited for ever; 20 GB and a NUL in its name were "a bug"."""
    os.mkfifo(tmp_path / "pipe.mtl")
    with (tmp_path / "huge.mtl").open("wb") as file:
        file.truncate(20 << 30)
    (tmp_path / "real.mtl").write_text("newmtl skin\nKd 1 0 0\n")
    for name in ("pipe.mtl", "huge.mtl", "a\0b.mtl", "none.mtl", "..", "/dev/zero", ""):
        path = tmp_path / "face.obj"
        path.write_text(f"mtllib {name}\nmtllib real.mtl\nusemtl skin\n{OBJ}")
        assert len(read_mesh(path).faces) == len(TRIANGLES)
    path.write_text("".join(f"mtllib {n}.mtl\n" for n in range(200_000)) + OBJ)
    assert len(read_obj(path).libraries) == 100
    assert len(read_mesh(path).faces) == len(TRIANGLES)


def test_an_obj_of_empty_lines_and_endless_polygons(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """400 MB of empty lines ran for minutes."""
    path = tmp_path / "face.obj"
    path.write_bytes(b"\n" * (limits.MAX_LINES + 1))
    assert "more than 20000000 lines" in refused(path)
    path.write_text(OBJ + "f" + " 1" * 500_000 + "\n")
    assert "too many corners" in refused(path)
    path.write_text(OBJ + "v" + " 1" * 500_000 + "\n")
    assert "too long" in refused(path)
    monkeypatch.setattr(limits, "MAX_TRIANGLES", 3000)
    path.write_text(OBJ + ("f" + " 1" * 1000 + "\n") * 4)
    assert "triangles or vertices" in refused(path)


@pytest.mark.parametrize("suffix", limits.EXTENSIONS)
def test_a_mesh_that_is_a_pipe_or_a_device(tmp_path: Path, suffix: str) -> None:
    os.mkfifo(tmp_path / f"pipe{suffix}")
    assert "is a pipe" in refused(tmp_path / f"pipe{suffix}")
    (tmp_path / f"zero{suffix}").symlink_to("/dev/zero")
    assert "is a pipe, a socket or a device" in refused(tmp_path / f"zero{suffix}")


def test_a_ply_whose_header_has_no_end(tmp_path: Path) -> None:
    path = tmp_path / "face.ply"
    comments = "comment " + "x" * 70_000 + "\n"
    path.write_text(f"ply\nformat ascii 1.0\n{comments}element vertex 9000000000\n")
    assert "its header has no end" in refused(path)


def test_instances_count_in_every_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What the check of the tree lets pass is counted again in trimesh's scene."""
    path = write_gltf(tmp_path / "face.gltf", tree(nodes=[{"mesh": 0}] * 3))
    content = json.loads(path.read_text()) | {"scenes": [{"nodes": [0, 1, 2]}]}
    write_gltf(path, content)
    monkeypatch.setattr(gltf, "_check_scene", lambda *_: None)
    monkeypatch.setattr(limits, "MAX_TRIANGLES", 2 * len(TRIANGLES))
    assert f"{3 * len(TRIANGLES)} triangles or vertices" in refused(path)
