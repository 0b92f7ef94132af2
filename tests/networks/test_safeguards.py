"""Inference safeguards: noise is estimated, and only trusted pixels keep their depth."""

from typing import Any

import cv2
import numpy as np
import pytest

from glsim import load_settings, simulate
from glsim.core.array_types import Depth
from glsim.denoise.registry import load_denoiser
from glsim.networks.network import NetworkFunction
from glsim.networks.safeguards import (
    HOLE_RISK_MM,
    MEASURED_RISK_MM,
    REACH_PX,
    clean_noise_mm,
    estimate_noise_mm,
    is_dithered,
    trusted_mask,
)
from tests.support.real_cameras import needs_real_cameras, real_depths
from tests.support.runners import Runs

NOISE_MM = np.random.default_rng(0).normal(0, 2, (96, 96)).astype(np.float32)


def ball() -> np.ndarray:
    """A ball of radius 100 mm at 900 mm, 2.5 mm per pixel, without a background."""
    y, x = np.mgrid[-48:48, -48:48] * 2.5
    inside = x * x + y * y < 95**2
    depth = 900 - np.sqrt(np.maximum(100**2 - x * x - y * y, 0))
    return np.where(inside, depth, 0).astype(np.float32)


@pytest.mark.parametrize("sigma_mm", [0.5, 1.5, 4.0])
def test_white_noise_is_measured(sigma_mm: float) -> None:
    noise = np.random.default_rng(0).normal(0, sigma_mm, (10, *ball().shape)).astype(np.float32)
    found = [estimate_noise_mm(np.where(ball() > 0, ball() + image, 0)) for image in noise]
    assert np.mean(found) == pytest.approx(sigma_mm, rel=0.03)


def test_rounding_to_millimetres_is_no_noise_and_little_depth_gives_no_estimate() -> None:
    rounded = clean_noise_mm(np.rint(ball()))
    assert 0.15 < rounded < 0.33
    assert estimate_noise_mm(np.zeros((20, 20), np.float32)) is None
    assert clean_noise_mm(np.zeros((20, 20), np.float32)) is None


@pytest.mark.parametrize(
    ("sensor", "distance_mm", "clean"),
    [
        ("ideal", 900, True),
        ("kinect-v2", 900, False),
        ("azure-kinect", 1800, False),
        # Nearer, its noise is below the rounding to millimetres.
        ("azure-kinect", 900, False),
        ("azure-kinect", 600, False),
        ("truedepth", 600, False),
    ],
)
def test_simulated_heads_are_told_apart(sensor: str, distance_mm: int, clean: bool) -> None:
    source = {"subjects": 4, "frames_per_subject": 2}
    overrides = {"sensor": sensor, "output": {"crop": 128}, "pose": {"distance_mm": distance_mm}}
    for frame in simulate(load_settings(overrides=overrides, source=source)):
        found = clean_noise_mm(frame.noisy.astype(np.float32))
        assert (found is not None) is clean


def in_steps(depth_mm: np.ndarray, step_mm: float) -> Depth:
    return (np.rint(depth_mm / step_mm) * step_mm).astype(np.float32)


@pytest.mark.parametrize("white_mm", [0.05, 0.15])
def test_noise_below_a_millimetre_shows_in_steps_of_a_tenth(white_mm: float) -> None:
    """Smooth noise of 0.25 mm under some white noise, as of a TrueDepth camera at 0.2 m."""
    white, smooth = np.random.default_rng(0).normal(0, 1, (2, 120, 120))
    smooth = cv2.GaussianBlur(smooth, (0, 0), 3)
    plane = np.broadcast_to(200 + 0.05 * np.arange(120), (120, 120))
    noisy = plane + 0.25 * smooth / smooth.std() + white_mm * white
    assert clean_noise_mm(in_steps(plane, 0.1)) is not None
    assert clean_noise_mm(in_steps(noisy, 0.1)) is None
    # In whole millimetres the white part must dither the steps.
    assert (clean_noise_mm(in_steps(noisy, 1.0)) is None) is (white_mm > 0.1)


@pytest.mark.long
@pytest.mark.parametrize("distance_mm", [400, 600, 750, 900, 1500])
@pytest.mark.parametrize("worn", ["head", "dressed", "wall"])
def test_clean_maps_are_not_dithered(distance_mm: int, worn: str) -> None:
    """Whole images; from 0.9 m on folds of cloth can pass for dither."""
    scene = {"wall_mm": distance_mm + 600} if worn == "wall" else {}
    wear = {"wear": "always", "glasses": 1.0, "cloth": 1.0} if worn == "dressed" else {}
    pose = {"distance_mm": min(distance_mm, 900 if wear else 1500), "yaw_deg": 20}
    overrides = {"sensor": "ideal", "seed": 12, "pose": pose, "scene": scene, "appearance": wear}
    source = {"kind": "procedural", "subjects": 2, "frames_per_subject": 1}
    for frame in simulate(load_settings(overrides=overrides, source=source)):
        depth = 1000 * frame.clean_m
        assert not is_dithered(in_steps(depth, 1.0), 1.0)
        white = np.random.default_rng(1).normal(0, 0.3, depth.shape)
        noisy = np.where(depth > 0, depth + white, 0)
        assert is_dithered(in_steps(noisy, 1.0), 1.0)
        assert not is_dithered(in_steps(noisy, 0.1), 0.1)


@needs_real_cameras
def test_parts_of_real_frames_in_whole_millimetres_are_noisy() -> None:
    """Crops of an Azure Kinect and a Kinect V1: the size of the noise alone keeps 11 of them."""
    crops = [
        np.ascontiguousarray(frame[y : y + 128, x : x + 128], np.float32)
        for folder in ("azure_kinect_mug", "kinect_v1_tables")
        for frame in real_depths(folder)
        for y in range(0, frame.shape[0] - 127, 128)
        for x in range(0, frame.shape[1] - 127, 128)
    ]
    covered = [crop for crop in crops if (crop > 0).mean() >= 0.5]
    assert len(covered) > 60
    # One part, of a dark wall in ten steps, lies just below the bounds.
    assert sum(clean_noise_mm(crop) is not None for crop in covered) <= 1


@needs_real_cameras
def test_boards_before_two_truedepth_cameras_are_noisy() -> None:
    frames = [
        frame.astype(np.float32)
        for folder in ("iPhone11Pro_iOS14", "iPadPro12_4gen_iOS15")
        for kind in ("eval", "board")
        for frame in real_depths(f"truedepth_zeiss/{kind}_{folder}", 0.1)
    ]
    assert len(frames) == 24
    assert all(clean_noise_mm(frame) is None for frame in frames)


def test_only_pixels_near_measured_depth_and_with_a_low_risk_are_trusted() -> None:
    depth = np.zeros((60, 60), np.float32)
    depth[30, 30] = 900
    near = trusted_mask(depth, None)
    assert near[30 + REACH_PX, 30 - REACH_PX]
    assert near.sum() == (2 * REACH_PX + 1) ** 2
    risk = np.full_like(depth, HOLE_RISK_MM / 2)
    risk[28] = HOLE_RISK_MM
    np.testing.assert_array_equal(trusted_mask(depth, risk)[28], False)
    assert (trusted_mask(depth, risk) == near)[np.arange(60) != 28].all()
    everywhere = np.full_like(depth, 900)
    assert trusted_mask(everywhere, risk).all()
    assert not trusted_mask(everywhere, np.full_like(depth, MEASURED_RISK_MM)).any()


class Shifts(Runs):
    """A network: moves depth by 5 mm, predicts depth everywhere, cannot choose on the left."""

    outputs: Any = ("depth_mm", "probability", "sigma_mm", "choice", "risk_mm")

    def __init__(self, probability: float = 0.9998) -> None:
        self._probability = probability

    def __call__(self, stack: Depth) -> dict[str, Depth]:
        noisy_mm = stack[0]
        risk_mm = np.full_like(noisy_mm, 0.1)
        risk_mm[:, :40] = 400.0
        return {
            "depth_mm": noisy_mm + 5,
            "probability": np.full_like(noisy_mm, self._probability),
            "sigma_mm": np.full_like(noisy_mm, 2.0),
            "choice": np.where(risk_mm > 1, np.float32(1 / 3), np.float32(1)),
            "risk_mm": risk_mm,
        }


def run(frame: Depth, probability: float = 0.9998, least: float = 0.0, clean: bool = True) -> Any:
    function = NetworkFunction(Shifts(probability), "shifts", least)
    function.keep_clean = clean
    return function(frame[None], frame[None] > 0, 0)


def test_a_network_returns_clean_frames_unchanged_and_drops_untrusted_pixels() -> None:
    clean = np.rint(ball())
    depth, probability, sigma = run(clean)
    np.testing.assert_array_equal(depth, clean)
    np.testing.assert_array_equal(probability, clean > 0)
    assert (sigma < 0.33).all()
    np.testing.assert_allclose(run(clean, clean=False)[0], clean + 5, rtol=1e-6)
    noisy = np.where(clean > 0, clean + NOISE_MM, 0)
    depth, probability, _ = run(noisy)
    np.testing.assert_allclose(depth, noisy + 5, rtol=1e-6)
    assert (probability[:, :40] == 0).all()
    assert probability[48, 48] > 0.99
    assert probability[0, 95] == 0, "nothing was measured near"


@pytest.mark.parametrize(("found", "kept"), [(0.1, 0.1), (0.4, 0.0)])
def test_unlikely_measured_pixels_keep_their_probability(found: float, kept: float) -> None:
    """A rejected pixel of low probability keeps it, so that the composite can drop it."""
    noisy = np.where(ball() > 0, ball() + NOISE_MM, 0).astype(np.float32)
    left = np.s_[:, :40]
    probability = run(noisy, found)[1]
    np.testing.assert_allclose(probability[left], np.where(noisy > 0, kept, 0)[left])


@pytest.mark.parametrize(
    ("sensor", "distance_mm"),
    [("realsense-d435", 500), pytest.param("truedepth", 450, marks=pytest.mark.long)],
)
def test_face_stereo_denoises_what_passes_for_clean(sensor: str, distance_mm: int) -> None:
    """The noise is smooth over 13 px, so that rules for the form of surfaces take it for form."""
    stereo, keeping = load_denoiser("face-stereo"), load_denoiser("face-stereo:keep_clean=1")
    overrides = {
        "sensor": sensor,
        "output": {"crop": 128, "depth_unit_mm": 0.1},
        "pose": {"distance_mm": distance_mm},
    }
    errors, kept = [], 0
    for frame in simulate(
        load_settings(overrides=overrides, source={"subjects": 6, "frames_per_subject": 1})
    ):
        noisy = (frame.noisy * np.float32(0.1)).astype(np.float32)
        truth = 1000 * frame.clean_m
        inside = (noisy > 0) & (cv2.erode(truth, np.ones((9, 9))) > 0)
        denoised = stereo.estimate(noisy[None]).depth_mm
        kept += np.array_equal(keeping.estimate(noisy[None]).depth_mm, noisy)
        assert np.abs(denoised - noisy)[inside].mean() > 0.1
        errors.append([np.std((image - truth)[inside]) for image in (noisy, denoised)])
    assert kept >= 2
    assert np.exp(np.diff(np.log(errors), axis=1).mean()) < 0.95


def test_a_minimum_probability_gives_a_mask() -> None:
    noisy = np.where(ball() > 0, ball() + NOISE_MM, 0).astype(np.float32)
    for probability, kept in ((0.99, True), (0.9999, False)):  # the network's is 0.9998
        valid = run(noisy, least=probability)[1]
        assert valid.dtype == bool
        assert valid[48, 48] == kept
        assert not valid[:, :40].any()
    clean = np.rint(ball())
    np.testing.assert_array_equal(run(clean, least=0.9)[1], clean > 0)
