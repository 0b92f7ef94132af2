"""Every format comes back as it was written, and every bad file gives one clear line."""

import json
import logging
import os
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from glsim.core.errors import MeshError
from glsim.faces.meshes import obj as limits
from glsim.faces.meshes.alignment import rotation
from glsim.faces.meshes.load import load_mesh, read_mesh
from glsim.faces.meshes.obj import EXTENSIONS
from tests.support.face_models import analytic_face

FACE, TRIANGLES = analytic_face(rows=31, columns=25)


def _export(mesh: trimesh.Trimesh | trimesh.Scene, path: Path, **options: Any) -> Path:
    if path.suffix == ".gltf":
        for name, data in mesh.export(file_type="gltf", **options).items():
            (path.parent / name).write_bytes(data)
        (path.parent / "model.gltf").rename(path)
    else:
        data = mesh.export(file_type=path.suffix[1:], **options)
        path.write_bytes(data.encode() if isinstance(data, str) else data)  # type: ignore[arg-type]
    return path


def _face(scale: float = 1.0, axes: str = "+x+y+z") -> trimesh.Trimesh:
    return trimesh.Trimesh(FACE @ rotation(axes) * scale, TRIANGLES, process=False)


def _obj(vertices: str, faces: str = "f 1 2 3") -> str:
    return f"{vertices}\n{faces}\n"


GOOD_OBJ = "".join(f"v {x:.4f} {y:.4f} {z:.4f}\n" for x, y, z in FACE) + "".join(
    f"f {a + 1} {b + 1} {c + 1}\n" for a, b, c in TRIANGLES
)


@pytest.mark.parametrize("extension", EXTENSIONS)
def test_every_format_comes_back(tmp_path: Path, extension: str) -> None:
    path = _export(_face(0.001, "+z+x+y"), tmp_path / f"face{extension}")
    loaded = load_mesh(path)
    assert (loaded.alignment.unit, loaded.alignment.axes) == ("m", "+z+x+y")
    reference = load_mesh(_export(_face(), tmp_path / "reference.ply")).mesh
    mesh = loaded.mesh
    assert mesh.vertices_mm.dtype == np.float32
    assert mesh.faces.dtype == np.int32
    assert mesh.albedo is None
    assert len(mesh.vertices_mm) == len(FACE)  # STL's triangle soup is welded again
    np.testing.assert_allclose(
        mesh.vertices_mm[mesh.faces], reference.vertices_mm[reference.faces], atol=0.6
    )


def test_quads_relative_numbers_groups_and_continued_lines(tmp_path: Path) -> None:
    path = tmp_path / "quads.obj"
    path.write_text(
        "# corner\nmtllib none.mtl\no a\nv 0 0 0\nv 100 0 0 \nv\t100 100 0\nv 0 100 \\\n0\n"
        "vt 0 0\nvn 0 0 1\ng b\nusemtl x\ns off\nf 1/1/1 2/1/1 3/1/1 4/1/1\n"
        "v 0 200 0\nf -1//1 -2//1 -3//1\nl 1 2\n"
    )
    mesh = read_mesh(path)
    assert mesh.vertices.shape == (5, 3)
    assert mesh.faces.tolist() == [[0, 1, 2], [0, 2, 3], [4, 3, 2]]


def test_settings_are_used_and_the_guess_is_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = _export(_face(), tmp_path / "face.ply")
    with caplog.at_level(logging.INFO, logger="glsim.faces.meshes.load"):
        loaded = load_mesh(path, recentre=False)
    np.testing.assert_allclose(loaded.mesh.vertices_mm, FACE, atol=1e-4)
    assert (
        f"{path}: unit mm, axes +x+y+z, 215 mm across (unit and axes found by rule" in caplog.text
    )
    assert json.loads(json.dumps(loaded.notes))["unit"] == "mm"
    given = load_mesh(path, unit="1.5", axes="-x+y-z")
    assert given.alignment.mm_per_unit == 1.5


def test_a_clockwise_mesh_is_turned_round(tmp_path: Path) -> None:
    mesh = _face()
    mesh.faces = mesh.faces[:, ::-1]
    loaded = load_mesh(_export(mesh, tmp_path / "inverted.ply"))
    assert loaded.notes["winding_flipped"] is True
    corner = loaded.mesh.vertices_mm[loaded.mesh.faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (normal[:, 2] > 0).all()


def test_several_geometries_are_put_together_where_the_scene_places_them(tmp_path: Path) -> None:
    low = FACE[TRIANGLES].mean(axis=1)[:, 1] < 0
    scene = trimesh.Scene()
    for number, part in enumerate((TRIANGLES[low], TRIANGLES[~low])):
        shift = np.eye(4)
        shift[:3, 3] = (0, 0, 50 * number)
        points = FACE - shift[:3, 3]
        scene.add_geometry(trimesh.Trimesh(points, part, process=False), transform=shift)
    mesh = read_mesh(_export(scene, tmp_path / "two.glb"))
    assert len(mesh.faces) == len(TRIANGLES)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), np.ptp(FACE, axis=0), atol=1e-3)


def test_vertex_colours_become_albedo_around_skin(tmp_path: Path) -> None:
    mesh = _face()
    grey = np.full((len(FACE), 4), 160, dtype=np.uint8)
    grey[:50] = 40
    mesh.visual.vertex_colors = grey
    for name in ("a.ply", "a.glb", "a.obj"):
        albedo = read_mesh(_export(mesh, tmp_path / name)).albedo
        np.testing.assert_allclose(albedo[50:], 0.6, atol=1e-3)
        np.testing.assert_allclose(albedo[:50], 0.15, atol=2e-3)
    mesh.visual.vertex_colors = np.full((len(FACE), 4), 90, dtype=np.uint8)
    assert read_mesh(_export(mesh, tmp_path / "one.ply")).albedo is None


def test_material_colours_become_albedo(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl skin\nKd 0.8 0.8 0.8\nnewmtl eye\nKd 0.2 0.2 0.2\n")
    vertices, faces = GOOD_OBJ[: GOOD_OBJ.index("f ")], GOOD_OBJ[GOOD_OBJ.index("f ") :]
    lines = faces.splitlines(keepends=True)
    text = f"mtllib a.mtl\n{vertices}usemtl skin\n{''.join(lines[:-9])}usemtl eye\n" + "".join(
        lines[-9:]
    )
    (tmp_path / "a.obj").write_text(text)
    albedo = read_mesh(tmp_path / "a.obj").albedo
    assert sorted(np.unique(albedo.round(3)).tolist()) == pytest.approx([0.15, 0.6])
    (tmp_path / "a.mtl").write_text("newmtl skin\nKd 0.8 0.8\nnewmtl eye\nKd a b c\n")
    assert read_mesh(tmp_path / "a.obj").albedo is None
    (tmp_path / "a.mtl").unlink()
    assert read_mesh(tmp_path / "a.obj").albedo is None


def test_degenerate_triangles_and_unused_vertices_are_dropped(tmp_path: Path) -> None:
    path = tmp_path / "a.obj"
    path.write_text("v nan 0 0\n" + GOOD_OBJ.replace("f ", "f 2 2 3\nf ", 1))
    path.write_text(path.read_text() + "f 3 3 3\n")
    text = path.read_text().replace("v nan 0 0\n", "") + "v nan inf 0\n"
    path.write_text(text)
    loaded = load_mesh(path)
    assert loaded.notes["degenerate_triangles_dropped"] == 2
    assert loaded.mesh.faces.shape == TRIANGLES.shape
    assert len(loaded.mesh.vertices_mm) == len(FACE)


BAD_TEXT = {
    "empty.obj": ("", "the file is empty"),
    "no_faces.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", "no triangles"),
    "no_vertices.obj": ("f 1 2 3\n", "no vertex lines"),
    "ragged.obj": (_obj("v 0 0 0\nv 1 0\nv 0 1 0"), "a vertex line is broken"),
    "five.obj": (_obj("v 0 0 0 1 1\nv 1 0 0 1 1\nv 0 1 0 1 1"), "has not 3 (x y z) or 6"),
    "face.obj": (_obj("v 0 0 0\nv 1 0 0\nv 0 1 0", "f 1 2 c"), "else than vertex numbers"),
    "cut.obj": (_obj("v 0 0 0\nv 1 0 0\nv 0 1 0", "f 1 2 3\nf "), "a face line has no corners"),
    "range.obj": (_obj("v 0 0 0\nv 1 0 0\nv 0 1 0", "f 1 2 4"), "uses vertex 4, but there are 3"),
    "nan.obj": (_obj("v 0 0 nan\nv 1 0 0\nv 0 1 0"), "1 of 1 triangles have a vertex at NaN"),
    "flat.obj": (_obj("v 0 0 0\nv 1 0 0\nv 2 0 0"), "all 1 triangles are degenerate"),
    "noseless.obj": (_obj("v 0 0 0\nv 200 0 0\nv 0 150 0"), "no face is found"),
    "empty.ply": ("ply\n", "damaged, cut short or not PLY"),
    "points.gltf": ("{}", "no triangles in it"),
    "face.fbx": ("0", ".fbx is not a mesh format"),
    "face": ("0", "a file without extension is not a mesh format"),
}


@pytest.mark.parametrize("name", BAD_TEXT)
def test_bad_files_give_one_clear_line(
    tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    text, message = BAD_TEXT[name]
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(MeshError) as caught:
        load_mesh(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: ")
    assert message in line
    assert capfd.readouterr() == ("", "")  # nothing by a library


def test_missing_files_and_folders_are_named(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match=r"nobody\.obj: cannot be read \(No such file"):
        load_mesh(tmp_path / "nobody.obj")
    with pytest.raises(MeshError, match="is a folder, not a mesh"):
        load_mesh(tmp_path)


@pytest.mark.parametrize("extension", [".ply", ".stl", ".glb", ".off"])
def test_truncated_files_are_refused(tmp_path: Path, extension: str) -> None:
    path = _export(_face(), tmp_path / f"cut{extension}")
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
    with pytest.raises(MeshError, match=r"cut short|no triangles"):
        load_mesh(path)


def test_face_numbers_out_of_range_in_a_ply_are_refused(tmp_path: Path) -> None:
    path = _export(_face(), tmp_path / "a.ply")
    data = bytearray(path.read_bytes())
    data[-4:] = struct.pack("<i", 10_000_000)
    path.write_bytes(data)
    with pytest.raises(MeshError, match="uses vertex 10000000, but there are 775 vertices"):
        load_mesh(path)


def test_huge_files_and_meshes_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    obj = tmp_path / "a.obj"
    with obj.open("wb") as file:  # a sparse file
        file.truncate(limits.MAX_BYTES + 1)
    with pytest.raises(MeshError, match="1000 MB are more than the 1000 allowed"):
        load_mesh(obj)
    monkeypatch.setattr(limits, "MAX_TRIANGLES", 100)
    obj.write_text(GOOD_OBJ)
    for path in (obj, _export(_face(), tmp_path / "a.glb")):
        with pytest.raises(MeshError, match=f"{len(TRIANGLES)} triangles, the limit is 100"):
            load_mesh(path)


def test_files_beside_a_mesh_lie_in_its_folder_and_pipes_are_refused(tmp_path: Path) -> None:
    folder = tmp_path / "mesh"
    folder.mkdir()
    path = _export(_face(), folder / "face.gltf")
    (folder / "gltf_buffer_0.bin").rename(tmp_path / "secret.bin")
    path.write_text(path.read_text().replace("gltf_buffer_0.bin", "../secret.bin"))
    with pytest.raises(MeshError, match="secret"):
        load_mesh(path)
    os.mkfifo(folder / "pipe.ply")
    with pytest.raises(MeshError, match="is a pipe"):
        load_mesh(folder / "pipe.ply")


def test_a_texture_is_no_albedo(tmp_path: Path) -> None:
    mesh = _face()
    picture = Image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
    mesh.visual = trimesh.visual.TextureVisuals(uv=FACE[:, :2] / 200 + 0.5, image=picture)
    for name in ("a.glb", "a.gltf"):
        assert read_mesh(_export(mesh, tmp_path / name)).albedo is None
