"""Exported frames: their bytes read back by Open3D, NumPy and OpenCV."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from glsim.cli import main
from glsim.core.camera import Distortion, Intrinsics
from glsim.core.depth_frame import DepthFrame, FrameKey
from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.exr import decode_exr, encode_exr
from glsim.core.units import to_mm
from glsim.data.export import FORMATS, export_dataset
from glsim.data.export.exported_frame import export_frames
from glsim.data.export.formats.cameras import centre_at_zero, open3d_json, ros_yaml
from glsim.data.export.formats.points import encode_ply, point_cloud
from glsim.data.reader import kept_lens, open_dataset
from tests.support.dataset_fakes import make, make_settings, make_tasks

CAMERA = Intrinsics(64, 48, 60.0, 61.0, 31.2, 22.9)
LAYERS = ("clean", "noisy", "infrared", "reason")


def sphere_frame(lens: Distortion | None = None) -> DepthFrame:
    """A sphere of 0.1 m at 0.9 m, seen by a camera whose principal point is off the middle."""
    key, record = FrameKey("a", "b", 0), {"regions": {"hair": 3}}
    frame = DepthFrame(key, CAMERA, {}, record=record, lens=lens or Distortion())
    ray = np.concatenate([frame.rays, np.ones((48, 64, 1))], -1).astype(np.float64)
    a, b = (ray**2).sum(-1), ray @ [0.01, -0.02, 0.9]
    root = b**2 - a * (0.01**2 + 0.02**2 + 0.9**2 - 0.1**2)
    depth = np.where(root > 0, (b - np.sqrt(np.maximum(root, 0))) / a, 0).astype(np.float32)
    regions = np.where(depth > 0, 3, 0).astype(np.uint8)
    infrared = (1000 * depth).astype(np.uint16)
    return frame.changed({"clean_mm": to_mm(depth), "regions": regions, "infrared": infrared})


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("exports") / "data"
    make(out, make_settings(layers=LAYERS), make_tasks(4, 2))
    return out


@pytest.mark.parametrize("lens", [None, Distortion(0.09, -0.27, 0.1, 0.001, -0.002)])
def test_points_lie_on_the_surface_and_normals_stand_on_it(lens: Distortion | None) -> None:
    frame = sphere_frame(lens)
    cloud = point_cloud(frame, "clean")
    at = np.stack([cloud[name] for name in "xyz"], -1) - np.array([0.01, -0.02, 0.9])
    assert len(cloud) == (frame.clean_mm > 0).sum() > 100
    np.testing.assert_allclose(np.linalg.norm(at, axis=1), 0.1, atol=1e-6)
    normal = np.stack([cloud[f"n{name}"] for name in "xyz"], -1)
    np.testing.assert_allclose(np.linalg.norm(normal, axis=1), 1, atol=1e-5)
    inner = -at[:, 2] > 0.06  # finite differences are good where the sphere is not seen edge on
    assert ((normal * at).sum(1)[inner] / 0.1).min() > 0.98
    assert set(cloud["region"]) == {3}
    np.testing.assert_array_equal(cloud["infrared"], (1000 * cloud["z"]).astype(np.uint16))


def test_open3d_reads_the_cloud(tmp_path: Path) -> None:
    o3d = pytest.importorskip("open3d")
    frame = sphere_frame()
    cloud = point_cloud(frame, "clean")
    file = tmp_path / "cloud.ply"
    file.write_bytes(encode_ply(cloud, frame))
    read = o3d.t.io.read_point_cloud(str(file))
    expected = np.stack([cloud[name] for name in "xyz"], -1)
    np.testing.assert_array_equal(read.point.positions.numpy(), expected)
    normals = np.stack([cloud[f"n{name}"] for name in "xyz"], -1)
    np.testing.assert_array_equal(read.point.normals.numpy(), normals)
    for name in ("infrared", "region"):
        np.testing.assert_array_equal(read.point[name].numpy()[:, 0], cloud[name])


def test_open3d_projects_our_camera_file_to_our_points(tmp_path: Path) -> None:
    """With our principal point unchanged its points would be off by half a pixel: 7 mm here."""
    o3d = pytest.importorskip("open3d")
    frame = sphere_frame()
    (tmp_path / "camera.json").write_bytes(open3d_json(frame.intrinsics))
    camera = o3d.io.read_pinhole_camera_parameters(str(tmp_path / "camera.json"))
    k = camera.intrinsic.intrinsic_matrix
    np.testing.assert_allclose(k, np.array([[60, 0, 30.7], [0, 61, 22.4], [0, 0, 1]]))
    image = o3d.geometry.Image(frame.in_metres("clean_mm"))
    theirs = o3d.geometry.PointCloud.create_from_depth_image(
        image, camera.intrinsic, camera.extrinsic, depth_scale=1.0, depth_trunc=10.0
    )
    ours = frame.points("clean_mm")[frame.clean_mm > 0]
    np.testing.assert_allclose(np.asarray(theirs.points), ours, atol=1e-6)


def test_opencv_projects_points_to_their_pixels() -> None:
    """Also through the lens, in the order of coefficients that OpenCV and ROS have."""
    import cv2

    lens = Distortion(0.09, -0.27, 0.1, 0.001, -0.002)
    frame = sphere_frame(lens)
    info = yaml.safe_load(ros_yaml(frame.intrinsics, lens, "glsim"))
    k = np.array(info["camera_matrix"]["data"]).reshape(3, 3)
    np.testing.assert_array_equal(k, centre_at_zero(frame.intrinsics))
    seen = frame.clean_mm > 0
    pixels, _ = cv2.projectPoints(
        frame.points("clean_mm")[seen].astype(np.float64),
        np.zeros(3),
        np.zeros(3),
        k,
        np.array(info["distortion_coefficients"]["data"]),
    )
    row, column = np.nonzero(seen)
    np.testing.assert_allclose(pixels[:, 0], np.stack([column, row], -1), atol=1e-3)
    assert (info["image_width"], info["image_height"]) == (64, 48)
    assert info["projection_matrix"]["data"][:3] == [60.0, 0.0, 30.7]


def test_the_lens_is_that_of_the_header() -> None:
    k = {"k1": 0.1, "k2": 0.2, "k3": 0.3, "p1": 0.4, "p2": 0.5}
    assert kept_lens({"sensor": {"deliver": "undistorted", "distortion": k}}) == Distortion()
    assert kept_lens({"sensor": {"deliver": "raw", "distortion": k}}) == Distortion(**k)
    assert kept_lens({}) == Distortion()


def test_the_exr_holds_the_depth_bit_by_bit() -> None:
    """Also of an array whose columns lie behind each other; the same bytes for the same depth."""
    pytest.importorskip("OpenEXR", reason="the extra glsim[formats] is not installed")
    rng = np.random.default_rng(1)
    depth = rng.uniform(0.5, 2.0, (37, 41)).astype(np.float32)
    depth[:20, :30] = 0
    for array in (depth, np.asfortranarray(depth)):
        data = encode_exr(array)
        channels = decode_exr(data, depth.size)
        assert list(channels) == ["Y"]
        assert channels["Y"].dtype == np.float32
        np.testing.assert_array_equal(channels["Y"], depth)
        assert data == encode_exr(depth)
    assert decode_exr(data, depth.size - 1) is None
    with pytest.raises(ValueError, match="is cut short, or no OpenEXR file"):
        decode_exr(data[:90], depth.size)


def test_arrays_hold_metres_and_everything_of_a_frame(data: Path, tmp_path: Path) -> None:
    assert export_dataset(open_dataset(data), tmp_path / "out", ["npz", "npy", "exr"]) == 8
    for pair in open_dataset(data):
        stem = pair.name
        noisy_m = np.load(tmp_path / "out" / f"{stem}_noisy.npy")
        np.testing.assert_array_equal(noisy_m, pair.noisy_mm / np.float32(1000))
        with np.load(tmp_path / "out" / f"{stem}.npz") as arrays:
            np.testing.assert_array_equal(arrays["noisy_m"], noisy_m)
            np.testing.assert_array_equal(arrays["infrared"], pair.infrared)
            np.testing.assert_array_equal(arrays["K"], centre_at_zero(pair.intrinsics))
            at = arrays["clean_points_m"]
            np.testing.assert_allclose(at, pair.intrinsics.unproject(arrays["clean_m"]))
            assert json.loads(str(arrays["record"]))["expression"] == pair.record["expression"]
            empty = arrays["clean_m"] == 0
            assert not arrays["clean_normals"][empty].any()


def test_the_same_frames_give_the_same_bytes(data: Path, tmp_path: Path) -> None:
    formats = ["ply", "npz", "npy", "exr", "open3d", "ros"]
    found = []
    for name in ("one", "two"):
        export_dataset(open_dataset(data), tmp_path / name, formats, split="test")
        files = sorted(path for path in (tmp_path / name).rglob("*") if path.is_file())
        found.append(
            {p.relative_to(tmp_path / name): hashlib.sha256(p.read_bytes()).digest() for p in files}
        )
    assert len(found[0]) >= 2 * 9
    assert found[0] == found[1]


def test_the_command_exports_frames_and_names_mistakes(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = ["export", str(data), "-o", str(out), "--to", "ply,open3d", "--layers", "noisy"]
    assert main([*arguments, "--frames", "1"]) == 0
    assert "wrote 1 frame as ply, open3d to" in capsys.readouterr().err.replace("\n", " ")
    assert len([path for path in out.rglob("*") if path.is_file()]) == 2
    for wrong, message in (
        (["--to", "plx"], "no such format 'plx'"),
        (["--layers", "reason"], "no layer of depth 'reason'"),
        (["--split", "tset"], "no such split 'tset'"),
    ):
        assert main(["export", str(data), "-o", str(out), *wrong]) in (1, 2)
        assert message in capsys.readouterr().err
    (tmp_path / "net.pt").write_bytes(b"")
    assert main(["export", str(tmp_path / "net.pt"), "-o", "net.onnx", "--to", "ply"]) == 2
    assert "is no data set" in capsys.readouterr().err


def test_a_library_that_is_missing_is_named_before_anything_is_written(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glsim.core.errors.find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r"exr needs OpenEXR, .*: pip install"):
        export_dataset(open_dataset(data), tmp_path / "out", ["npy", "exr"])
    assert not (tmp_path / "out").exists()


def test_mistakes_in_calls_are_named(data: Path, tmp_path: Path) -> None:
    dataset = open_dataset(data)
    with pytest.raises(ConfigError, match="is the data set itself"):
        export_dataset(dataset, data, ["npy"])
    with pytest.raises(ConfigError, match="at least one format"):
        export_dataset(dataset, tmp_path, [])
    make(tmp_path / "few", make_settings(), make_tasks(1, 1))
    with pytest.raises(DatasetError, match="no frame in test"):
        export_dataset(open_dataset(tmp_path / "few"), tmp_path / "o", ["npy"], split="test")
    assert len(list(export_frames(dataset, count=3))) == 3
    assert "ply" in FORMATS
