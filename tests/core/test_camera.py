"""Projection, rays, lens distortion: against OpenCV, and over the whole image of known devices."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from glsim.core.camera import Distortion, Intrinsics, SensorRig
from glsim.core.errors import ConfigError
from tests.support.scenes import V2, V2_LENS, rig

#: Calibrations of six Kinect V2: fx, fy, cx, cy, k1, k2, k3, p1, p2 (libfreenect2 issues 41 and
#: 670, iai_kinect2, CodingTrain).
UNITS = {
    "A": (368.096588, 368.096588, 261.696594, 202.522202, 0.084061, -0.271582, 0.101907, 0, 0),
    "B": (365.402802, 365.402802, 260.925507, 205.594604, 0.095575, -0.277055, 0.097539, 0, 0),
    "C": (365.456, 365.456, 254.878, 205.395, 0.0905474, -0.26819, 0.0950862, 0, 0),
    "D": (366.95, 364.79, 242.99, 207.70, 0.09656, -0.28298, 0.10524, 1.6e-4, -5.1e-4),
    "E": (366.38, 367.14, 255.65, 203.98, 0.10953, -0.31462, 0.12565, -1.26e-3, -7.2e-4),
    "F": (362.31, 362.52, 260.13, 205.96, 0.0979, -0.2823, 0.1060, 3.8e-4, 9.1e-4),
}

#: OpenCV 4 has a separate function with a number of iterations.
UNDISTORT = getattr(cv2, "undistortPointsIter", cv2.undistortPoints)


def unit(name: str) -> SensorRig:
    fx, fy, cx, cy, k1, k2, k3, p1, p2 = UNITS[name]
    image = Intrinsics(512, 424, fx, fy, cx, cy)
    return rig(image=image, distortion=Distortion(k1, k2, k3, p1, p2), deliver="raw")


def opencv_matrix(image: Intrinsics) -> np.ndarray:
    """OpenCV's camera matrix; here both sides of a comparison put pixel centres at integers."""
    return np.array([[image.fx, 0, image.cx], [0, image.fy, image.cy], [0, 0, 1]])


def opencv_lens(lens: Distortion) -> np.ndarray:
    return np.array([lens.k1, lens.k2, lens.p1, lens.p2, lens.k3])


side, focal, centre = st.integers(8, 200), st.floats(100, 900), st.floats(-50, 750)
cameras = st.builds(Intrinsics, side, side, focal, focal, centre, centre)


@settings(max_examples=30)
@given(cameras, st.floats(0.2, 9))
def test_projecting_what_was_unprojected_gives_the_pixel_centres(
    image: Intrinsics, depth_m: float
) -> None:
    points = image.unproject(np.full((image.height, image.width), depth_m, np.float32))
    seen = image.project(points.reshape(-1, 3)).reshape(image.height, image.width, 2)
    u, v = np.meshgrid(np.arange(image.width) + 0.5, np.arange(image.height) + 0.5)
    np.testing.assert_allclose(seen, np.stack([u, v], axis=-1), atol=1e-3)
    np.testing.assert_allclose(points[..., 2], depth_m, rtol=1e-6)


@settings(max_examples=30)
@given(cameras, st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.2, 9)))
def test_clip_matrix_projects_as_the_camera_does(
    image: Intrinsics, point: tuple[float, float, float]
) -> None:
    clip = image.clip_matrix(0.1, 12.0).astype(np.float64) @ [*point, 1.0]
    ndc = clip[:3] / clip[3]
    pixel = (ndc[:2] + 1) / 2 * (image.width, image.height)
    np.testing.assert_allclose(pixel, image.project(np.array([point]))[0], rtol=1e-4, atol=2e-2)
    assert -1 <= ndc[2] <= 1


@pytest.mark.parametrize(("z_m", "ndc"), [(0.1, -1.0), (12.0, 1.0)])
def test_clip_planes_are_where_they_should_be(z_m: float, ndc: float) -> None:
    clip = V2.clip_matrix(0.1, 12.0) @ np.array([0, 0, z_m, 1])
    assert clip[2] / clip[3] == pytest.approx(ndc, abs=1e-5)


def test_cropping_moves_the_principal_point_only() -> None:
    part = V2.cropped(100, 50, 64, 32)
    assert (part.width, part.height) == (64, 32)
    np.testing.assert_allclose(part.rays(), V2.rays()[50:82, 100:164], atol=1e-6)


@pytest.mark.parametrize("name", UNITS)
def test_lens_puts_points_where_opencv_does(name: str) -> None:
    device = unit(name)
    image, lens = device.intrinsics, device.distortion
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-0.7, 0.7, (500, 2)), np.ones(500)])
    theirs, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), opencv_matrix(image), opencv_lens(lens)
    )
    seen = lens.distort(points[:, :2]) * (image.fx, image.fy) + (image.cx, image.cy)
    np.testing.assert_allclose(seen, theirs[:, 0], atol=1e-6)


@pytest.mark.parametrize("name", UNITS)
def test_raw_rays_are_the_inverse_over_the_whole_image(name: str) -> None:
    device = unit(name)
    image, lens = device.intrinsics, device.distortion
    rays = device.rays()
    there = image.rays().astype(np.float64)
    off_px = np.abs(lens.distort(rays) - there).max() * image.fx
    assert off_px < 1e-3
    # On the branch that contains the axis: farther out in the image is farther out in the world.
    assert (np.diff(rays[..., 0], axis=1) > 0).all()
    assert (np.diff(rays[..., 1], axis=0) > 0).all()
    u, v = np.meshgrid(np.arange(0, 512, 37) + 0.5, np.arange(0, 424, 41) + 0.5)
    pixels = np.stack([u.ravel(), v.ravel()], axis=-1)
    criteria = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 200, 1e-10)
    matrix, same = opencv_matrix(image), np.eye(3)
    theirs = UNDISTORT(pixels[:, None], matrix, opencv_lens(lens), None, same, same, criteria)
    ours = rays[pixels[:, 1].astype(int), pixels[:, 0].astype(int)]
    np.testing.assert_allclose(ours, theirs[:, 0], atol=2e-6)


@pytest.mark.parametrize("name", UNITS)
def test_pinhole_of_a_raw_rig_holds_every_ray(name: str) -> None:
    device = unit(name)
    pinhole = device.pinhole()
    at = device.rays() * (pinhole.fx, pinhole.fy) + (pinhole.cx, pinhole.cy)
    assert at.min() >= 1
    assert at[..., 0].max() < pinhole.width - 1
    assert at[..., 1].max() < pinhole.height - 1
    assert pinhole.width < 1.2 * device.intrinsics.width


@pytest.mark.parametrize(
    "lens",
    [
        pytest.param(Distortion(k1=-0.8), id="barrel folds before the corner"),
        pytest.param(Distortion(k1=0.09, k2=-0.95), id="k2 too strong"),
        pytest.param(Distortion(p1=2.0), id="tangential"),
        pytest.param(Distortion(k3=-40.0), id="k3 mistaken for another"),
    ],
)
def test_lens_that_folds_inside_the_image_is_refused(lens: Distortion) -> None:
    with pytest.raises(ConfigError, match="cannot be inverted over the whole image: check the"):
        rig(distortion=lens, deliver="raw").rays()


def test_undistorted_delivery_ignores_the_lens() -> None:
    device = rig(distortion=V2_LENS)
    assert not device.keeps_distortion
    assert device.pinhole() == V2
    np.testing.assert_array_equal(device.rays(), V2.rays())


def test_baseline_is_that_of_the_first_emitter() -> None:
    assert rig().baseline_m == 0.0
    assert rig((0.03, 0.04, 0.0), (1.0, 0.0, 0.0)).baseline_m == pytest.approx(0.05)


#: The factory calibration of an Azure Kinect (pyk4a's test recording).
AZURE = Distortion(
    k1=0.54793978, k2=-0.02097137, k3=-0.00265223, p1=2.0557534e-5, p2=-7.2104158e-5,
    k4=0.88967907, k5=0.08613021, k6=-0.01391038, limit_tan=1.74,
)  # fmt: skip


def test_the_rational_lens_is_opencvs_and_is_inverted_to_its_limit() -> None:
    turn = np.linspace(0, 2 * np.pi, 50)[:, None]
    ideal = np.linspace(0.05, 1.7, 40) * np.stack([np.cos(turn), np.sin(turn)])
    points = np.moveaxis(ideal, 0, -1).reshape(-1, 2)
    lens = np.array(
        [AZURE.k1, AZURE.k2, AZURE.p1, AZURE.p2, AZURE.k3, AZURE.k4, AZURE.k5, AZURE.k6]
    )
    rays = np.column_stack([points, np.ones(len(points))])
    seen, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), np.eye(3), lens)
    assert AZURE.distort(points) == pytest.approx(seen[:, 0], abs=1e-9)
    assert AZURE.undistort(np.asarray(seen[:, 0], np.float64)) == pytest.approx(points, abs=1e-4)
    beyond = AZURE.undistort(np.array([[1.4, 1.4], [-2.0, 0.0]]))
    assert np.linalg.norm(beyond, axis=1) == pytest.approx([1.74, 1.74], abs=0.01)


def test_a_limit_beyond_the_lens_models_fold_is_refused() -> None:
    with pytest.raises(ConfigError, match="folds before limit_tan"):
        replace(AZURE, limit_tan=5.0).undistort(np.zeros((1, 2)))
