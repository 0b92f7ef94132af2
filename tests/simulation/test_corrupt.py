"""Noise on the user's own depth maps, by OpenGL and by NumPy."""

import zlib
from pathlib import Path

import numpy as np
import pytest
from moderngl import Context
from numpy.typing import NDArray

from glsim.cli import main
from glsim.core import depth_map
from glsim.core.camera import Intrinsics
from glsim.core.errors import ConfigError
from glsim.core.files.png import encode_png, stated_unit_mm
from glsim.core.reason import Reason
from glsim.core.units import from_steps, to_metres
from glsim.data.maps import open_maps
from glsim.settings.schema import load_settings
from glsim.simulation.depth_noise import DepthNoise
from glsim.simulation.frame import Frame
from tests.support.scenes import V2, Plane, face_mesh, frames_of, layers_of, rig, settings_for

SENSORS = ["ideal", "kinect-v1", "kinect-v2", "kinect-v2-paper"]


def turned_face(context: Context, crop: int | None = 160) -> NDArray[np.uint16]:
    """A face before a wall, whole millimetres."""
    pose = {"distance_mm": 900, "yaw_deg": 20}
    settings = settings_for(scene={"wall_mm": 1300}, pose=pose, output={"crop": crop})
    return frames_of(context, settings, face_mesh())[0].clean


@pytest.fixture
def clean(context: Context) -> NDArray[np.uint16]:
    return turned_face(context)


def corrupted(
    sensor: str,
    clean: NDArray[np.uint16],
    name: str = "a",
    backend: str | None = None,
    **overrides: object,
) -> Frame:
    settings = load_settings(overrides={"sensor": sensor} | overrides)
    with DepthNoise(settings, backend=backend) as noise:
        return noise.corrupt_depth(to_metres(from_steps(clean)), sequence=name)


@pytest.mark.parametrize("sensor", SENSORS)
def test_both_backends_agree(context: Context, sensor: str) -> None:
    """Shadow edges differ: a map's mesh ends at pixel centres, the NumPy march at pixel borders."""
    clean = turned_face(context, crop=None)
    drawn, computed = corrupted(sensor, clean), corrupted(sensor, clean, backend="numpy")
    one, other = drawn.noisy.astype(int), computed.noisy.astype(int)
    assert ((one > 0) == (other > 0)).mean() >= 0.995
    both = (one > 0) & (other > 0)
    assert both.mean() > 0.7
    assert (np.abs(one - other)[both] <= 1).mean() >= 0.998  # haze in shadows is just decodable
    assert (drawn.reason == computed.reason).mean() >= 0.995
    np.testing.assert_array_equal(drawn.clean, clean)
    np.testing.assert_array_equal(computed.clean, clean)
    if sensor != "ideal":
        assert (one != clean).mean() > 0.5
        # Time of flight fills all but the middle of a shadow from its sides.
        assert (drawn.reason == Reason.SHADOW).sum() > (0 if sensor == "kinect-v2" else 50)


@pytest.mark.parametrize("backend", [None, "numpy"])
def test_name_and_seed_decide_the_noise(clean: NDArray[np.uint16], backend: str | None) -> None:
    settings = load_settings()
    with DepthNoise(settings, backend=backend) as corrupter:
        first = corrupter.corrupt_depth(to_metres(from_steps(clean)), sequence="a").noisy
        other = corrupter.corrupt_depth(to_metres(from_steps(clean)), sequence="b").noisy
        again = corrupter.corrupt_depth(to_metres(from_steps(clean)), sequence="a").noisy
    np.testing.assert_array_equal(first, again)
    assert (first != other).mean() > 0.3
    fresh = corrupted("kinect-v2", clean, "a", backend)
    np.testing.assert_array_equal(first, fresh.noisy)
    assert (corrupted("kinect-v2", clean, "a", backend, seed=1).noisy != first).mean() > 0.3


def test_several_may_be_used_in_turn(clean: NDArray[np.uint16]) -> None:
    settings = load_settings()
    small = np.ascontiguousarray(clean[:64, :64])
    alone = [zlib.crc32(corrupted("kinect-v2", map_).noisy.data) for map_ in (clean, small)]
    with DepthNoise(settings) as one, DepthNoise(settings) as other:
        for _ in range(2):
            for noise, map_, wanted in ((one, clean, alone[0]), (other, small, alone[1])):
                frame = noise.corrupt_depth(to_metres(from_steps(map_)), sequence="a")
                assert zlib.crc32(frame.noisy.data) == wanted


@pytest.mark.parametrize("backend", [None, "numpy"])
@pytest.mark.parametrize("sensor", ["kinect-v1", "kinect-v2", "kinect-v2-paper"])
def test_nothing_stays_nothing(sensor: str, backend: str | None) -> None:
    """Maps without depth stay empty; a map of a single pixel, which is no surface, is accepted."""
    lone = np.zeros((40, 40), np.uint16)
    frame = corrupted(sensor, lone, backend=backend)
    assert not frame.noisy.any()
    assert not frame.clean.any()
    assert (frame.reason == Reason.NO_SURFACE).all()
    lone[20, 20] = 900
    assert corrupted(sensor, lone, backend=backend).clean[20, 20] == 900


def test_a_shader_of_the_users_own_needs_opengl(
    tmp_path_factory: pytest.TempPathFactory, clean: NDArray[np.uint16]
) -> None:
    """Even if the file has the name of a shipped stage, whose twin it must not use."""
    from tests.support.scenes import sensor_file

    folder = tmp_path_factory.mktemp("own")
    (folder / "gaussian.glsl").write_text(
        "#version 330 core\n// own\nuniform sampler2D u_depth;\nout float depth;\n"
        "void main() { depth = 2.0 * texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r; }\n"
    )
    sensor = sensor_file(folder, 'use = "gaussian.glsl"')
    np.testing.assert_array_equal(corrupted(sensor, clean).noisy, 2 * clean)
    with pytest.raises(ConfigError, match="'gaussian' has no NumPy twin: use --backend egl or"):
        corrupted(sensor, clean, backend="numpy")


def test_cameras_default_to_the_sensors_own() -> None:
    def camera(shape: tuple[int, int], **given: tuple[float, float]) -> list[float]:
        image = DepthNoise(**given).rig(shape).intrinsics
        return [image.width, image.height, image.fx, image.fy, image.cx, image.cy]

    f = V2.fx
    assert camera((424, 512)) == [512, 424, f, f, V2.cx, V2.cy]
    assert camera((60, 80)) == [80, 60, f, f, 40, 30]
    given = camera((60, 80), focal_px=(500, 510), centre_px=(10, 20))
    assert given == [80, 60, 500, 510, 10, 20]


def test_normals_of_a_map_are_those_of_its_plane() -> None:
    for tilt, turn in ((0, 0), (40, 30), (70, 200)):
        plane = Plane(1.0, tilt, turn)
        depth = plane.depth(V2.rays()).astype(np.float32)
        seen = (depth > 0.3) & (depth < 3)
        normal = depth_map.normals(np.where(seen, depth, np.float32(0)), V2.rays())
        assert np.abs(normal - plane.normal)[seen].max() < 5e-3
        assert (normal[~seen] == [0, 0, -1]).all()
    # Beside a step they are those of the pixel's own side.
    steps = np.full((V2.height, V2.width), 1.0, np.float32)
    steps[:, 200:] = 1.5
    normal = depth_map.normals(steps, V2.rays())
    np.testing.assert_allclose(normal, np.broadcast_to([0, 0, -1.0], normal.shape), atol=1e-6)


def test_the_surface_of_a_map_is_where_it_was_seen(context: Context) -> None:
    seen = layers_of(context, rig(), [(face_mesh(), {"distance_mm": 900})])["clean"]
    mesh = depth_map.surface(seen, rig())
    again = layers_of(context, rig(), [mesh])["clean"]
    both = (seen > 0) & (again > 0)
    assert both.sum() > 0.9 * (seen > 0).sum()
    assert np.abs(seen - again)[both].max() < 1e-5
    assert depth_map.surface(np.zeros_like(seen), rig()) is None


@pytest.mark.parametrize(
    ("clean_states_mm", "given", "stated_mm"),
    [(None, [], 1.0), (0.1, ["--depth-unit-mm", "0.1"], 0.1), (1.0, [], 1.0),
     (None, ["--depth-unit-mm", "0.5"], 0.5)],
)  # fmt: skip
def test_a_noisy_map_states_its_step(
    tmp_path: Path, capsys: pytest.CaptureFixture[str],
    clean_states_mm: float | None, given: list[str], stated_mm: float | None,
) -> None:  # fmt: skip
    clean, noisy = tmp_path / "clean.png", tmp_path / "noisy.png"
    image = np.full((32, 40), 9000, np.uint16)
    clean.write_bytes(encode_png(image, clean_states_mm))
    command = ["corrupt", str(clean), "-o", str(noisy), "-s", "ideal", "--backend", "numpy"]
    assert main([*command, *given]) == 0
    assert "wrote 1 noisy ideal depth map to" in capsys.readouterr().err
    assert stated_unit_mm(noisy) == stated_mm
    image[:, 1:] = 19_000
    image[8:, 0] = 0
    clean.write_bytes(encode_png(image))
    assert main(command) == 1
    assert "clean: 99.36 % of its depth is lost: check its unit" in capsys.readouterr().err
    for option, value, words in (
        ("--backend", "cuda", "'egl', 'osmesa', 'numpy'"),
        ("--focal-px", "abc", "--focal-px abc: give one number or two numbers"),
        ("--depth-unit-mm", "0", "give a step of 0.01 to 10 mm"),
    ):
        assert main([*command, option, value]) == 2
        assert words in capsys.readouterr().err


@pytest.mark.parametrize("form", ["png", "tiff", "npy"])
def test_sensor_camera_and_unit_go_with_noisy_and_denoised_maps(tmp_path: Path, form: str) -> None:
    clean, noisy, out = (tmp_path / name for name in ("clean", "noisy", "out"))
    clean.mkdir()
    for number in range(2):
        image = np.full((32, 40), 900 + 20 * number, np.uint16)
        (clean / f"{number}_clean.png").write_bytes(encode_png(image))
    (clean / "camera.toml").write_text("width=40\nheight=32\nfocal_px=[30,31]\nname='my: k'")
    command = ["corrupt", str(clean), "-o", str(noisy), "-s", "kinect-v2", "--backend", "numpy"]
    assert main(command) == 0
    command = ["denoise", str(noisy), "-o", str(out), "-d", "median", "--format", form]
    assert main(command) == 0
    (noisy / "camera.toml").unlink()
    assert open_maps(noisy).recognised.sensor == open_maps(noisy).simulated_by == "kinect-v2"
    denoised = open_maps(out)
    assert denoised.recognised.sensor == "kinect-v2"
    assert denoised.camera == Intrinsics(40, 32, 30, 31, 20, 16)
    assert denoised.stated.name == "kinect-v2: my: k"
    assert denoised.frames[0].step_mm == {"png": 0.1, "tiff": 1.0, "npy": 0.0}[form]
    assert abs(denoised.frames[0].noisy_mm[8:24, 8:32].mean() - 900) < 20
    (out / "camera.toml").write_text('name = "mine"\n')
    assert main(command) == 0
    assert (out / "camera.toml").read_text() == 'name = "mine"\n', "a user's file stays"
