"""A tree of meshes becomes subjects, sequences and frames; bad meshes become BadFace."""

import re
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from glsim.cli import main
from glsim.core.errors import ConfigError
from glsim.data.driver import generate
from glsim.data.reader import open_dataset
from glsim.faces import open_source
from glsim.faces.face_source import BadFace, Face, FaceKey, FaceSource
from glsim.faces.meshes.alignment import Turns, rotation
from glsim.faces.sources.folder import Folder
from glsim.settings.schema import load_settings
from glsim.settings.source_settings import parse_source
from tests.support.face_models import analytic_face
from tests.support.face_sets import all_keys, assert_keys_decide, good_faces
from tests.support.imports import ROOT
from tests.support.scenes import face_mesh
from tests.support.user_rights import ordinary_user

FACE, TRIANGLES = analytic_face(rows=31, columns=25)


def _write(path: Path, *, scale: float = 1.0, axes: str = "+x+y+z", up_mm: float = 0.0) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    points = (FACE + np.array([0, up_mm, 0])) @ rotation(axes) * scale
    data = trimesh.Trimesh(points, TRIANGLES, process=False).export(file_type=path.suffix[1:])
    path.write_bytes(data if isinstance(data, bytes) else data.encode())


def test_names_of_subjects_sequences_and_frames(tmp_path: Path) -> None:
    names = "Joe/1+2/1+2_150.ply Joe/1+2/1+2_156.ply Joe/4/deep/x10.ply Joe/4/deep/x9.ply"
    names += " Joe/rest.stl s10/a.obj s2/a.obj s2/b.obj alone.obj .hidden/a.obj s2/.a.obj"
    for name in names.split():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.touch()
    (tmp_path / "notes.txt").touch()
    (tmp_path / "empty").mkdir()
    source: FaceSource = Folder(tmp_path)
    assert source.name == "folder"
    assert source.subjects(None) == ["alone", "Joe", "s2", "s10"]
    assert source.subjects(2) == ["alone", "Joe"]
    assert source.frames("alone", None) == [FaceKey("alone", "main", 0, 0.0, "alone.obj")]
    assert [(k.sequence, k.frame, k.path) for k in source.frames("Joe", None)] == [
        ("main", 0, "Joe/rest.stl"),
        ("1+2", 150, "Joe/1+2/1+2_150.ply"),
        ("1+2", 156, "Joe/1+2/1+2_156.ply"),
        ("4-deep", 9, "Joe/4/deep/x9.ply"),
        ("4-deep", 10, "Joe/4/deep/x10.ply"),
    ]
    assert [k.time_s for k in source.frames("Joe", 3)] == [0.0, 0.0, pytest.approx(0.1)]
    s2 = [(k.frame, k.path) for k in source.frames("s2", None)]
    assert s2 == [(0, "s2/a.obj"), (1, "s2/b.obj")]


def test_odd_names_become_safe_unique_words(tmp_path: Path) -> None:
    for name in ("a b/x.obj", "a.b/x.obj", "a_b/x.obj", "a_b/p q/x.obj", "a_b/p-q/x.obj",
                 "a_b/p/q/x.obj", "käse.obj", "face.obj", "face.ply", "twice/l_1.obj",
                 "twice/r_1.obj"):  # fmt: skip
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    source = Folder(tmp_path)
    keys = all_keys(source)
    places = [(key.subject, key.sequence, key.frame) for key in keys]
    assert len(set(places)) == len(places) == 11
    safe = re.compile(r"[A-Za-z0-9_+~-]+")
    assert all(safe.fullmatch(key.subject) and safe.fullmatch(key.sequence) for key in keys)
    assert source.subjects(None) == [
        "a_b", "a_b~2", "a_b~3", "face", "face~2", "k_se", "twice"
    ]  # fmt: skip
    assert {k.sequence for k in source.frames("a_b~3", None)} == {"main", "p_q", "p-q", "p-q~2"}
    assert [k.frame for k in source.frames("twice", None)] == [0, 1]  # 1 and 1 tell nothing apart


def test_unit_and_axes_are_kept_for_a_subject_and_the_origin_for_a_sequence(tmp_path: Path) -> None:
    for frame, up_mm in enumerate((0.0, 7.0, 30.0)):
        _write(tmp_path / f"a/smile/{frame}.ply", scale=0.1, axes="+z+x+y", up_mm=up_mm)
    _write(tmp_path / "a/blink/0.ply", scale=0.1, axes="+z+x+y", up_mm=50)
    _write(tmp_path / "b.stl", axes="-x+y-z")
    # A frame that alone would be read as metres: its subject says centimetres.
    _write(tmp_path / "a/tiny.ply", scale=0.001, axes="+z+x+y")
    source = Folder(tmp_path)
    keys = all_keys(source)
    by_path = dict(zip([key.path for key in keys], source.load(keys), strict=True))
    # The first mesh in order: all of subject "a" is in metres now.
    assert isinstance(by_path["a/tiny.ply"], Face)
    assert "it is 21,500 mm across" in str(by_path["a/smile/1.ply"].error)

    (tmp_path / "a/tiny.ply").unlink()
    source = Folder(tmp_path)
    keys = all_keys(source)
    faces = dict(zip([key.path for key in keys], good_faces(source, keys), strict=True))
    first, second, third = (faces[f"a/smile/{n}.ply"].mesh for n in range(3))
    np.testing.assert_allclose(second.vertices_mm - first.vertices_mm, [[0, 7, 0]] * len(FACE),
                               atol=1e-3)  # fmt: skip
    np.testing.assert_allclose((third.vertices_mm - first.vertices_mm)[:, 1], 30, atol=1e-3)
    assert first.faces is second.faces  # one topology, one array
    blink = faces["a/blink/0.ply"].mesh
    np.testing.assert_allclose(blink.vertices_mm, first.vertices_mm, atol=1.0)
    assert faces["a/blink/0.ply"].notes["unit"] == "cm"
    assert faces["b.stl"].notes["axes"] == "-x+y-z"


def test_overrides_place_single_meshes_and_folders(tmp_path: Path) -> None:
    for name, axes, scale in (("a/0.ply", "+x+y+z", 1.0), ("a/1.ply", "+x-y-z", 1.0),
                              ("b/x/0.ply", "-x+y-z", 1 / 25.4)):  # fmt: skip
        _write(tmp_path / name, axes=axes, scale=scale)
    overrides = {"a/1.ply": {"axes": "+x+y+z", "rotation_deg": [180, 0, 0]}, "b": {"unit": "inch"}}
    table = {"kind": "folder", "root": tmp_path, "unit": "mm", "overrides": overrides}
    source = open_source(parse_source(table), 0)
    first, second, third = (face.mesh.vertices_mm for face in good_faces(source, all_keys(source)))
    np.testing.assert_allclose(second, first, atol=1e-3)
    np.testing.assert_allclose(third, first, atol=1e-3)
    wrong = open_source(parse_source(table | {"overrides": {"a/2.ply": {"unit": "cm"}}}), 0)
    with pytest.raises(ConfigError, match=r"overrides: no mesh 'a/2.ply' in .*did you mean 'a/"):
        wrong.subjects(None)


@pytest.mark.long
def test_a_face_depends_on_its_key_alone(tmp_path: Path) -> None:
    for frame in range(4):
        _write(tmp_path / f"a/{frame}.ply", up_mm=5.0 * frame)
    source = Folder(tmp_path)
    keys = all_keys(source)
    forwards = assert_keys_decide(source, keys)
    for key, face in zip(keys, forwards, strict=True):
        assert_keys_decide(Folder(tmp_path), [key], [face])


def test_bad_meshes_are_bad_faces_and_do_not_stop_the_rest(tmp_path: Path) -> None:
    _write(tmp_path / "a/1.ply")
    (tmp_path / "a/0.obj").write_text("v 0 0 0\n")
    (tmp_path / "a/2.ply").write_bytes(b"garbage")
    (tmp_path / "b").mkdir()
    (tmp_path / "b/0.obj").write_text("v 0 0 0\nv 90 0 0\nv 0 90 0\nf 1 2 3\n")
    source = Folder(tmp_path)
    results = list(source.load(all_keys(source)))
    assert [type(result) for result in results] == [BadFace, Face, BadFace, BadFace]
    reasons = [str(result.error) for result in results if isinstance(result, BadFace)]
    assert "no triangles" in reasons[0]
    assert "not PLY" in reasons[1]
    assert "no face is found" in reasons[2]
    assert all(str(tmp_path) in reason for reason in reasons)
    (tmp_path / "b/0.obj").unlink()
    again = list(source.load(all_keys(source)[-1:] * 2))
    assert [str(result.error) for result in again] == reasons[2:] * 2, "it is not read again"


def test_wrong_settings_give_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no such folder; give the folder"):
        Folder(tmp_path / "nowhere")
    (tmp_path / "file.txt").touch()
    with pytest.raises(ConfigError, match="is a file, not a folder"):
        Folder(tmp_path / "file.txt")
    with pytest.raises(ConfigError, match=r"no mesh in it or below it \(\.obj, \.ply"):
        Folder(tmp_path).subjects(None)
    (tmp_path / "a.obj").touch()
    source = Folder(tmp_path)
    with pytest.raises(ConfigError, match="has 1 subject, 2 asked for"):
        source.subjects(2)
    with pytest.raises(ConfigError, match=r"no subject 'aa' \(did you mean 'a'"):
        source.frames("aa", None)
    with pytest.raises(ConfigError, match="no such unit"):
        Folder(tmp_path, unit="ell")
    with pytest.raises(ConfigError, match="axes='up'"):
        Folder(tmp_path, axes="up")


def test_a_folder_that_cannot_be_listed_is_named() -> None:
    with ordinary_user() as folder:
        (folder / "locked").mkdir(mode=0)
        with pytest.raises(ConfigError, match="locked: cannot be listed"):
            Folder(folder).subjects(None)


def test_one_scan_gives_as_many_pairs_as_are_asked_for(tmp_path: Path) -> None:
    _write(tmp_path / "scans" / "a.ply")
    source = {"kind": "folder", "root": tmp_path / "scans", "frames_per_subject": 4}
    turned = {"yaw_deg": {"uniform": [-30, 30]}}
    tree = {"source": source, "output": {"crop": 96}, "pose": turned}
    settings = load_settings(overrides=tree)
    generate(settings, tmp_path / "data", workers=1)
    frames = list(open_dataset(tmp_path / "data").frames())
    assert len(frames) == 4
    assert all((frame.noisy_mm > 0).sum() > 500 for frame in frames)
    for one, other in combinations(frames, 2):
        assert not np.array_equal(one.clean_mm, other.clean_mm)  # another pose
        assert not np.array_equal(one.noisy_mm, other.noisy_mm)


@pytest.mark.parametrize("turns", [(0.0, 0.0, 0.0), (-31.9, -8.4, 5.3)])
def test_a_page_leads_from_a_vertex_to_its_pixel(turns: Turns, tmp_path: Path) -> None:
    page = (ROOT / "docs/howto/data_sets.md").read_text(encoding="utf-8")
    defined: dict[str, Any] = {}
    exec(re.findall(r"```python\n(.*?)```", page, re.DOTALL)[0], defined)
    mesh = face_mesh(120)
    vertices = 0.1 * mesh.vertices_mm @ rotation("+x+z-y", turns) + (3, 4, 5)  # cm, other axes
    lines = ["v {} {} {}".format(*row) for row in vertices]
    lines += ["f {} {} {}".format(*(face + 1)) for face in mesh.faces]
    (tmp_path / "scans").mkdir()
    (tmp_path / "scans" / "a.obj").write_text("\n".join(lines))
    command = ["generate", "-o", str(tmp_path / "d"), "--source", "folder", "--root"]
    command += [str(tmp_path / "scans"), "--frames-per-subject", "2", "--sensor", "ideal", "-q"]
    command += ["--set", "pose.yaw_deg={uniform=[-30,30]}", "--set", "output.depth_unit_mm=0.1"]
    tilted = ["--set", "source.axes=+x+z-y", "--set", f"source.rotation_deg={[*turns]}"]
    command += tilted if any(turns) else []  # else found in the mesh
    assert main([*command, "--set", "output.crop=200", "--workers", "1"]) == 0
    for frame in open_dataset(tmp_path / "d"):
        column, row, depth_mm = defined["pixels_of"](vertices, frame.record)
        seen = frame["clean_mm"][row.astype(int), column.astype(int)]
        facing = (seen > 0) & (np.abs(seen - depth_mm) < 20)
        assert facing.mean() > 0.5
        off_mm = (seen - depth_mm)[facing]
        assert abs(np.median(off_mm)) < 0.1
        assert np.median(np.abs(off_mm)) < 0.8, "vertices lie up to half a pixel, 1.2 mm, away"
