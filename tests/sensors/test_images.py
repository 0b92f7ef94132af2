"""Images of a sensor: the map of a fixed pattern, and the pattern of a projector."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from moderngl import Context
from numpy.typing import NDArray

import glsim
from glsim.bench import scenes
from glsim.core.errors import ConfigError
from glsim.core.files.png import encode_png
from glsim.faces.one_mesh import OneMesh
from glsim.sensors.images import read_projector_image
from glsim.sensors.sensor import SENSOR_FOLDER, load_sensor
from glsim.settings.schema import load_settings
from glsim.simulation.depth_noise import DepthNoise
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import simulate
from glsim.simulation.virtual_camera import VirtualCamera
from tests.support.scenes import face_mesh, only_frame, rig_toml

SHAPE = (424, 512)
HOLE = np.s_[150:260, 200:240]


def a_map() -> NDArray[np.float32]:
    """Errors of 1 mm with an unknown rectangle."""
    values = np.random.default_rng(1).normal(0, 1, SHAPE).astype(np.float32)
    values[HOLE] = np.nan
    return values


def sensor_file(folder: Path, values: NDArray[np.generic] | None, stage: str = "") -> str:
    """A kinect-v2-fast of one stage, with a map beside it: no noise but the pattern."""
    rig = (SENSOR_FOLDER / "kinect-v2-fast.toml").read_text().split("[[stage]]")[0]
    rig = rig.replace("[rig]", '[rig]\nfixed_pattern_map = "own.npy"', 1)
    stage = stage or 'use = "fixed_pattern"\nrow_alternation_mm = 0\nrow_sigma_mm = 0'
    file = folder / "own.toml"
    file.write_text(f"{rig}\n[[stage]]\n{stage}\n")
    if values is not None:
        np.save(folder / "own.npy", values)
    return str(file)


def test_the_map_is_the_pattern_of_every_frame_and_crop(context: Context, tmp_path: Path) -> None:
    values = a_map()
    camera = VirtualCamera(sensor_file(tmp_path, values), context)
    whole = camera.capture(scenes.wall(900), 2, None)
    error = whole.measured_mm - whole.truth_mm
    assert np.array_equal(error[0], error[1])
    known = np.isfinite(values)
    assert np.abs(error[0] - values)[known].max() < 1e-3  # float32 metres at 0.9 m: 6e-5 mm
    # Where the map knows nothing the pattern is drawn: pixels of 0.25 mm, columns of 0.2 mm.
    drawn = error[0][HOLE]
    assert 0.2 < drawn.std() < 0.5
    crop = camera.capture(scenes.wall(900), 1, 96, at_mm=(60, 40, 900))
    image = camera.rig.intrinsics
    left = round(float(crop[0].rays[0, 0, 0]) * image.fx + image.cx - 0.5)
    top = round(float(crop[0].rays[0, 0, 1]) * image.fy + image.cy - 0.5)
    assert (left, top) != (0, 0)
    part = np.s_[top : top + 96, left : left + 96]
    assert np.array_equal(crop.measured_mm[0], whole.measured_mm[0][part])
    # Another device has the same map, and another drawn pattern.
    other = camera.capture(scenes.wall(900), 1, None, seed=5)
    again = other.measured_mm[0] - other.truth_mm
    assert np.array_equal(again[known], error[0][known])
    assert not np.array_equal(again[HOLE], drawn)


def test_shader_and_twin_add_the_same_map(context: Context, tmp_path: Path) -> None:
    file = sensor_file(tmp_path, a_map())
    settings = load_settings(overrides={"sensor": file, "output": {"depth_unit_mm": 0.1}})
    flat = np.full(SHAPE, 0.9, np.float32)
    noisy = []
    for backend in (None, "numpy"):
        with DepthNoise(settings, backend=backend) as corrupter:
            noisy.append(1000.0 * corrupter.corrupt_depth(flat).noisy_m)
    assert np.abs(noisy[0] - noisy[1]).max() < 1e-3
    with pytest.raises(ConfigError, match=r"own.npy: the map of the fixed pattern is 512x424, the"):
        DepthNoise(settings, backend="numpy").corrupt_depth(flat[:100, :100])


def test_the_header_of_a_data_set_names_the_map_by_its_values(tmp_path: Path) -> None:
    values = a_map()
    file = sensor_file(tmp_path, values)
    first = load_sensor(file).describe()["fixed_pattern_map"]
    values[0, 0] += 1
    np.save(tmp_path / "own.npy", values)
    assert load_sensor(file).describe()["fixed_pattern_map"] != first
    assert "fixed_pattern_map" not in load_sensor("kinect-v2").describe()


def test_maps_that_cannot_serve(tmp_path: Path) -> None:
    def refused(match: str, values: NDArray[np.generic] | None, stage: str = "") -> None:
        (tmp_path / "own.npy").unlink(missing_ok=True)
        file = sensor_file(tmp_path, values, stage)
        with pytest.raises(ConfigError, match=match):
            load_sensor(file)

    refused(r"own.npy: no such file: rig.fixed_pattern_map names", None)
    refused("the map of the fixed pattern is 424x512, the image 512x424", a_map().T)
    refused("knows no pixel", np.full(SHAPE, np.nan, np.float32))
    refused("has infinite values", np.full(SHAPE, np.inf, np.float32))
    refused("errors of up to 900 mm, the limit is 20: give mm", np.full(SHAPE, 900.0))
    refused("must be one array of floats", np.zeros(SHAPE, np.uint8))
    refused("is read by no stage: add stage 'fixed_pattern'", a_map(), 'use = "gaussian"')
    (tmp_path / "own.npy").write_bytes(b"no array")
    with pytest.raises(ConfigError, match=r"own.npy: cannot be read: is no whole .npy file"):
        load_sensor(sensor_file(tmp_path, None))


def test_remove_fixed_pattern_undoes_it() -> None:
    values = a_map()
    true = np.full(SHAPE, 900.0)
    measured = true + np.nan_to_num(values)
    measured[:3] = 0
    measured[3:6] = np.nan
    clean = glsim.remove_fixed_pattern(np.stack([measured, measured]), values)
    assert (clean.dtype, clean.shape) == (np.float32, (2, *SHAPE))
    assert np.abs(clean[:, 6:] - 900.0).max() < 1e-3
    assert (clean[:, :3] == 0).all()
    assert np.isnan(clean[:, 3:6]).all()
    whole = glsim.remove_fixed_pattern(np.full(SHAPE, 900, np.uint16), values)
    known = np.isfinite(values)
    assert np.allclose(whole[known], 900 - values[known])
    assert (whole[~known] == 900).all()
    with pytest.raises(ConfigError, match="is 512x424, the image 96x96"):
        glsim.remove_fixed_pattern(np.zeros((96, 96)), values)


RIG = rig_toml(200, 150, 140)
PATTERN = 'projector_image = "dots.png"\nprojector_view_deg = [80, 64]\n'
#: Without noise and blur: light alone.
QUIET = """
[[stage]]
use = "stereo_light"
flood = 0
ambient_counts = 0
[[stage]]
use = "stereo_exposure"
shot_counts = 0
read_sigma_counts = 0
speckle_sigma = 0
pixel_gain_sigma = 0
psf_sigma_px = 0
longest_exposure = 0
"""


def sensor_file_image(folder: Path, image: NDArray[Any] | bytes | None, stages: str = "") -> str:
    """A small D435 beside its pattern."""
    if image is not None:
        data = image if isinstance(image, bytes) else cv2.imencode(".png", image)[1].tobytes()
        (folder / "dots.png").write_bytes(data)
    file = folder / "own.toml"
    file.write_text(f'extends = "realsense-d435"\ntitle = "own"\n{RIG}{PATTERN}{stages}')
    return str(file)


def frame_of(sensor: str, **stage: dict[str, float]) -> Frame:
    """A plate before a wall at 1 m."""
    settings = load_settings(
        overrides={
            "sensor": sensor,
            "stage": stage,
            "pose": {"distance_mm": 700, "motion": 0},
            "scene": {"wall_mm": 1000},
        },
        source={"subjects": 1, "frames_per_subject": 1},
    )
    return only_frame(simulate(settings, sources=[OneMesh(face_mesh(40))]))


def random_dots(shape: tuple[int, int], share: float = 0.05) -> NDArray[np.uint8]:
    return (255 * (np.random.default_rng(2).random(shape) < share)).astype(np.uint8)


def test_a_spot_lies_where_the_projector_throws_it(context: Context, tmp_path: Path) -> None:
    """One spot, up and to the left as the camera sees it, on the wall at 1 m."""
    image = np.zeros((64, 80), np.uint16)
    image[6:9, 9:12] = 65535
    frame = frame_of(sensor_file_image(tmp_path, image, QUIET))
    tangent = np.tan(np.radians([40, 32])) * ((np.array([10.5, 7.5]) / (80, 64)) * 2 - 1)
    point = np.array([0.028, 0]) + tangent * 1.0  # the projector's place, then its ray
    for name, imager in (("infrared", 0.0), ("infrared_right", 0.05017)):
        light = frame.image(name).astype(float)
        assert light.max() > 50
        seen = 140 * (point - (imager, 0)) + (100, 75)
        ys, xs = np.nonzero(light > 0.2 * light.max())
        assert np.abs((xs.mean() + 0.5, ys.mean() + 0.5) - seen).max() < 0.5
        assert max(np.ptp(xs), np.ptp(ys)) < 14, "three pixels of the image are 9 of the camera"


def test_depth_is_measured_by_the_image(context: Context, tmp_path: Path) -> None:
    sensor = sensor_file_image(tmp_path, random_dots((120, 150), 0.1))
    frame = frame_of(sensor)
    both = (frame.clean > 0) & (frame.noisy > 0)
    assert both.mean() > 0.6
    assert np.median(np.abs(frame.noisy.astype(float) - frame.clean)[both]) < 15
    dark = frame_of(sensor, stereo_light={"gain_counts": 0, "texture_share": 0})
    assert (dark.noisy > 0).mean() < 0.4, "without pattern and texture little is found"


def test_none_of_a_fine_pattern_is_lost(tmp_path: Path) -> None:
    """The mean over a pixel of the camera keeps all light, wherever the dots lie."""
    image = random_dots((1500, 2000), 0.01)
    image[:20] = image[-20:] = image[:, :20] = image[:, -20:] = 0
    sensor_file_image(tmp_path, image)
    found = read_projector_image(tmp_path / "dots.png", (80, 64), (140, 140)).values
    assert found.sum(dtype=float) == pytest.approx(image.sum(dtype=float) / 255, rel=1e-5)
    assert 0 < found.max() < 0.5, "dots of one pixel are spread over those that the camera sees"
    coarse = read_projector_image(tmp_path / "dots.png", (80, 64), (5000, 5000)).values
    assert np.array_equal(coarse, image / np.float32(255)), "coarser than the camera: as it is"


def test_the_header_of_a_data_set_names_the_image_by_its_values(tmp_path: Path) -> None:
    image = random_dots((30, 40))
    file = sensor_file_image(tmp_path, image)
    first = load_sensor(file).describe()["projector_image"]
    assert first["size_px"] == [40, 30]
    image[3, 4] ^= 255
    sensor_file_image(tmp_path, image)
    assert load_sensor(file).describe()["projector_image"] != first
    assert "projector_image" not in load_sensor("realsense-d435").describe()


def test_a_sensor_that_extends_one_finds_its_image_and_can_switch_it_off(tmp_path: Path) -> None:
    sensor_file_image(tmp_path, random_dots((30, 40)))
    (tmp_path / "deep").mkdir()
    mine = tmp_path / "deep" / "mine.toml"
    mine.write_text('extends = "../own.toml"\ntitle = "mine"\n')
    image = load_sensor(str(mine)).projector_image
    assert image.values.shape == (30, 40)
    off = load_sensor(str(mine), rig_overrides={"projector_image": ""})
    assert off.projector_image is None
    assert off.rig.projector_tan == (0.0, 0.0)


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (None, r"dots\.png: no such file: rig\.projector_image names a PNG"),
        (b"no image", r"dots\.png: is no readable image"),
        (encode_png(random_dots((30, 40)))[:-40], r"dots\.png: is no readable image"),
        (np.zeros((30, 40, 3), np.uint8), r"dots\.png: is no readable image .* grey PNG"),
        (np.zeros((30, 40, 4), np.uint16), r"dots\.png: is no readable image .* grey PNG"),
        (np.full((8, 4097), 9, np.uint8), r"4097x8 pixels.* 2 to 4096 on each side"),
        (np.full((1, 40), 9, np.uint8), r"40x1 pixels.* 2 to 4096 on each side"),
        (np.zeros((30, 40), np.uint8), r"dots\.png: is black"),
        (cv2.imencode(".tiff", np.ones((30, 40), np.float32))[1].tobytes(), "8 or 16 bits"),
    ],
)
def test_images_that_cannot_serve(
    tmp_path: Path, image: NDArray[Any] | bytes | None, words: str
) -> None:
    with pytest.raises(ConfigError, match=words):
        load_sensor(sensor_file_image(tmp_path, image))


def test_rigs_that_cannot_throw_an_image(tmp_path: Path) -> None:
    sensor_file_image(tmp_path, random_dots((30, 40)))
    pattern = PATTERN.replace("dots.png", str(tmp_path / "dots.png"))
    file = tmp_path / "other.toml"
    for sensor in ("ideal", "realsense-d405", "kinect-v1"):
        file.write_text(f'extends = "{sensor}"\ntitle = "own"\n[rig]\n{pattern}')
        with pytest.raises(ConfigError, match="is read by no stage: add stage 'stereo_light'"):
            load_sensor(str(file))
    for view, words in (
        ("", "needs the field of view"),
        ("projector_view_deg = [80]", "projector_view_deg"),
        ("projector_view_deg = [0, 60]", "projector_view_deg"),
        ("projector_view_deg = [80, 180]", "projector_view_deg"),
    ):
        head = pattern.splitlines()[0]
        file.write_text(f'extends = "realsense-d435"\ntitle = "own"\n[rig]\n{head}\n{view}\n')
        with pytest.raises(ConfigError, match=words):
            load_sensor(str(file))
