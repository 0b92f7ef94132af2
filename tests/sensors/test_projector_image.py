"""A projector's pattern from an image file: what it throws and where, and images it refuses."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.errors import ConfigError
from glsim.core.files.png import encode_png
from glsim.faces.one_mesh import OneMesh
from glsim.sensors.images import read_projector_image
from glsim.sensors.sensor import load_sensor
from glsim.settings.schema import load_settings
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import simulate
from tests.support.scenes import face_mesh

RIG = """
[rig]
width = 200
height = 150
focal_px = [140, 140]
centre_px = [100, 75]
"""
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


def sensor_file(folder: Path, image: NDArray[Any] | bytes | None, stages: str = "") -> str:
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
    (frame,) = simulate(settings, sources=[OneMesh(face_mesh(40))])
    assert isinstance(frame, Frame)
    return frame


def random_dots(shape: tuple[int, int], share: float = 0.05) -> NDArray[np.uint8]:
    return (255 * (np.random.default_rng(2).random(shape) < share)).astype(np.uint8)


def test_a_spot_lies_where_the_projector_throws_it(
    context: moderngl.Context, tmp_path: Path
) -> None:
    """One spot, up and to the left as the camera sees it, on the wall at 1 m."""
    image = np.zeros((64, 80), np.uint16)
    image[6:9, 9:12] = 65535
    frame = frame_of(sensor_file(tmp_path, image, QUIET))
    tangent = np.tan(np.radians([40, 32])) * ((np.array([10.5, 7.5]) / (80, 64)) * 2 - 1)
    point = np.array([0.028, 0]) + tangent * 1.0  # the projector's place, then its ray
    for name, imager in (("infrared", 0.0), ("infrared_right", 0.05017)):
        light = frame.image(name).astype(float)
        assert light.max() > 50
        seen = 140 * (point - (imager, 0)) + (100, 75)
        ys, xs = np.nonzero(light > 0.2 * light.max())
        assert np.abs((xs.mean() + 0.5, ys.mean() + 0.5) - seen).max() < 0.5
        assert max(np.ptp(xs), np.ptp(ys)) < 14, "three pixels of the image are 9 of the camera"


def test_depth_is_measured_by_the_image(context: moderngl.Context, tmp_path: Path) -> None:
    sensor = sensor_file(tmp_path, random_dots((120, 150), 0.1))
    frame = frame_of(sensor)
    both = (frame.clean > 0) & (frame.noisy > 0)
    assert both.mean() > 0.6
    assert np.median(np.abs(frame.noisy.astype(float) - frame.clean)[both]) < 15
    dark = frame_of(sensor, stereo_light={"gain_counts": 0})
    assert (dark.noisy > 0).mean() < 0.4, "without the pattern little is found"


def test_none_of_a_fine_pattern_is_lost(tmp_path: Path) -> None:
    """The mean over a pixel of the camera keeps all light, wherever the dots lie."""
    image = random_dots((1500, 2000), 0.01)
    image[:20] = image[-20:] = image[:, :20] = image[:, -20:] = 0
    sensor_file(tmp_path, image)
    found = read_projector_image(tmp_path / "dots.png", (80, 64), (140, 140)).values
    assert found.sum(dtype=float) == pytest.approx(image.sum(dtype=float) / 255, rel=1e-5)
    assert 0 < found.max() < 0.5, "dots of one pixel are spread over those that the camera sees"
    coarse = read_projector_image(tmp_path / "dots.png", (80, 64), (5000, 5000)).values
    assert np.array_equal(coarse, image / np.float32(255)), "coarser than the camera: as it is"


def test_the_header_of_a_data_set_names_the_image_by_its_values(tmp_path: Path) -> None:
    image = random_dots((30, 40))
    file = sensor_file(tmp_path, image)
    first = load_sensor(file).describe()["projector_image"]
    assert first["size_px"] == [40, 30]
    image[3, 4] ^= 255
    sensor_file(tmp_path, image)
    assert load_sensor(file).describe()["projector_image"] != first
    assert "projector_image" not in load_sensor("realsense-d435").describe()


def test_a_sensor_that_extends_one_finds_its_image_and_can_switch_it_off(tmp_path: Path) -> None:
    sensor_file(tmp_path, random_dots((30, 40)))
    (tmp_path / "deep").mkdir()
    mine = tmp_path / "deep" / "mine.toml"
    mine.write_text('extends = "../own.toml"\ntitle = "mine"\n')
    image = load_sensor(str(mine)).projector_image
    assert image is not None
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
    with pytest.raises(ConfigError, match=words) as caught:
        load_sensor(sensor_file(tmp_path, image))
    assert "\n" not in str(caught.value)


def test_rigs_that_cannot_throw_an_image(tmp_path: Path) -> None:
    sensor_file(tmp_path, random_dots((30, 40)))
    pattern = PATTERN.replace("dots.png", str(tmp_path / "dots.png"))
    file = tmp_path / "other.toml"
    for sensor in (
        "ideal",
        "realsense-d405",
        "kinect-v1",
    ):
        file.write_text(f'extends = "{sensor}"\ntitle = "own"\n[rig]\n{pattern}')
        with pytest.raises(ConfigError, match="no stage reads it: add the stage 'stereo_light'"):
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
