"""Damaged files and arrays of any kind: depth, meshes and faces of finite size, or one line."""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from glsim.core.errors import GlsimError
from glsim.core.files.exr import encode_exr
from glsim.core.files.png import encode_png
from glsim.core.mesh import Mesh
from glsim.data.map_files import FAR_MM
from glsim.data.maps import open_maps
from glsim.faces.face_source import BadFace, FaceSource
from glsim.faces.meshes.load import load_mesh
from glsim.faces.sources.biwi import Biwi
from glsim.faces.sources.facewarehouse import FaceWarehouse
from tests.support.bags import azure_calibration, write_bag, write_mkv, write_topics
from tests.support.face_sets import FACE, TRIANGLES, all_keys, write_recording, write_tester

DEPTH = np.arange(24 * 32, dtype=np.uint16).reshape(24, 32) + np.uint16(600)
YAML = (
    "%YAML:1.0\n---\ncameraMatrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n"
    "   data: [ 365.4, 0., 254.8, 0., 365.4, 205.4, 0., 0., 1. ]\n"
)
TEXTS = {
    "camera.toml": "unit_mm = 0.5\nwidth = 32\nheight = 24\nfocal_px = [30.0, 30.0]\n",
    "calib_ir.yaml": YAML,
}
#: A file of a face set -> its source, and a function that writes such a set.
FACE_SETS: dict[str, tuple[Callable[[Path], FaceSource], Callable[[Path], object]]] = {
    "Tester_1/Blendshape/shape.bs": (FaceWarehouse, lambda root: write_tester(root, poses=0)),
    "01/frame_00004_pose.txt": (Biwi, lambda root: write_recording(root, frames=2)),
}
MESHES = {
    f"face{end}": trimesh.Trimesh(FACE, TRIANGLES, process=False)
    for end in (".obj", ".ply", ".stl", ".glb", ".off")
}
any_case = settings(max_examples=60, derandomize=True)


def write_whole(folder: Path, name: str) -> bytes:
    """Write a recording with a file of this name, and return the bytes of that file."""
    file = folder / name
    file.unlink(missing_ok=True)
    if name in FACE_SETS:
        FACE_SETS[name][1](folder)
    elif name in MESHES:
        data = MESHES[name].export(file_type=file.suffix[1:])
        file.write_bytes(data.encode() if isinstance(data, str) else data)
    elif name in TEXTS:
        (folder / "depth_0.png").write_bytes(encode_png(DEPTH))
        file.write_text(TEXTS[name])
    elif file.suffix == ".npy":
        np.save(file, np.stack([DEPTH, DEPTH]))
    elif file.suffix == ".exr":
        file.write_bytes(encode_exr(DEPTH.astype(np.float32) / 1000))
    elif file.suffix == ".bag":
        write_bag(file, [DEPTH] * 2)
    elif file.suffix == ".mcap":
        write_topics(file, {"/depth/image": (DEPTH, "16UC1")}, {}, count=2)
    elif file.suffix == ".mkv":
        write_mkv(file, {"DEPTH": [DEPTH] * 2}, azure_calibration())
    else:
        cv2.imwrite(str(file), DEPTH)
    return file.read_bytes()


def refused(path: Path, name: str = "") -> str:
    """Read a file and check what it holds: return the line that refuses it, else ""."""
    if name in FACE_SETS:
        source = FACE_SETS[name][0](path)
        keys = [key for key in all_keys(source) if key.path == name] or all_keys(source)
        faces = list(source.load(keys[:1] + keys[-1:]))
        for face in faces:
            assert isinstance(face, BadFace) or sound(face.mesh)
        return "".join(str(face.error) for face in faces[:1] if isinstance(face, BadFace))
    try:
        if name in MESHES:
            assert sound(load_mesh(path / name, unit="mm", axes="+x+y+z").mesh)
            return ""
        recording = open_maps(path)
        images = [frame.noisy_mm for frame in recording.read(2)]
        assert len({image.shape for image in images}) == 1
    except GlsimError as error:
        return str(error)
    for image in images:
        assert (image.ndim, image.dtype) == (2, np.float32)
        assert np.isfinite(image).all()
        assert 0 <= image.min() <= image.max() < FAR_MM
        assert image.any()
    return ""


def sound(mesh: Mesh) -> bool:
    inside = 0 <= mesh.faces.min() <= mesh.faces.max() < len(mesh.vertices_mm)
    return bool(inside and np.isfinite(mesh.vertices_mm).all())


@pytest.mark.parametrize(
    "name",
    [
        "depth_0.png", "depth_0.tiff", "depth.npy", *TEXTS,
        *(pytest.param(f"depth.{end}", marks=pytest.mark.long) for end in ("exr", "bag", "mcap")),
        *(pytest.param(n, marks=pytest.mark.long) for n in ("depth.mkv", *FACE_SETS, *MESHES)),
    ],
)  # fmt: skip
@any_case
@given(
    at=st.floats(0, 1) | st.floats(0, 0.02), length=st.integers(0, 40), new=st.binary(max_size=12)
)
def test_damage_anywhere_is_sound_or_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, at: float, length: int, new: bytes
) -> None:
    """Most of a format's structure stands at its start: half of the damage lies there."""
    whole = write_whole(tmp_path, name)
    start = int(at * len(whole))
    (tmp_path / name).write_bytes(whole[:start] + new + whole[start + length :] * (length < 40))
    line = refused(tmp_path, name)
    assert line == "" or str(tmp_path) in line
    assert capfd.readouterr() == ("", "")  # nothing by a library


@any_case
@given(
    kind=st.sampled_from(["u1", "<u2", ">u2", "i2", "<i4", "f2", "f4", ">f8", "?", "c8"]),
    shape=st.lists(st.sampled_from([0, 1, 2, 3, 4, 8, 24]), max_size=4),
    seed=st.integers(0, 99),
)
def test_any_array_is_depth_or_one_line(
    tmp_path: Path, kind: str, shape: list[int], seed: int
) -> None:
    """Random bits hold infinities, values that are no numbers, and 1e30."""
    file = tmp_path / "a.npy"
    size = int(np.prod(shape)) * np.dtype(kind).itemsize
    data = np.random.default_rng(seed).bytes(size)
    np.save(file, np.frombuffer(data, kind).reshape(shape))
    line = refused(file)
    with_depth = np.dtype(kind).kind == "f" or np.dtype(kind).str[1:] == "u2"
    axes = [side for side in shape if side != 1]
    if not with_depth or 0 in shape or len(axes) == 4:
        assert str(file) in line
    if kind == "<u2" and len(shape) == 2 and min(shape) >= 8:
        assert line == ""
        stored = np.frombuffer(data, kind).reshape(shape)
        kept = np.where(stored < FAR_MM, stored, 0)
        np.testing.assert_array_equal(open_maps([file], unit_mm=1.0).frames[0].noisy_mm, kept)
