"""The default composite keeps rims and shadows, drops flying pixels and fills small holes."""

import cv2
import numpy as np
import pytest

from glsim.core.array_types import Depth
from glsim.denoise.denoiser import Denoiser
from glsim.networks.composites import BESIDE_PX, composed
from glsim.networks.interface import Denoised
from glsim.networks.network import NetworkFunction
from tests.support.runners import Runs

HEAD_MM, WALL_MM = 900.0, 1500.0
_SQUARE = np.ones((3, 3), np.uint8)


def head_before_wall() -> Depth:
    """A ball of 90 mm radius at 900 mm, 2.5 mm per pixel, before a wall; a shadow of 4 px."""
    y, x = np.mgrid[-50:50, -60:60] * 2.5
    inside = x * x + y * y < 88**2
    ball = HEAD_MM + 90 - np.sqrt(np.maximum(90**2 - x * x - y * y, 0))
    depth = np.where(inside, ball, WALL_MM).astype(np.float32)
    shadow = np.roll(inside, 4, axis=1) & ~inside
    depth[shadow] = 0
    return depth


def measured(depth_mm: Depth, probability: Depth, noisy_mm: Depth) -> Depth:
    return np.asarray(composed(Denoised(depth_mm, probability), noisy_mm, "measured"))


def rings(mask: np.ndarray, count: int) -> list[np.ndarray]:
    """The outermost rings of a mask, 1 px wide each."""
    found = []
    for _ in range(count):
        inner = cv2.erode(mask.astype(np.uint8), _SQUARE, borderValue=1) > 0
        found.append(mask & ~inner)
        mask = inner
    return found


def test_a_rim_that_the_network_doubts_is_kept() -> None:
    noisy = head_before_wall()
    head = (noisy > 0) & (noisy < 1200)
    rim = np.logical_or(*rings(head, 2))
    probability = np.where(rim | (noisy == 0), 0.3, 0.99).astype(np.float32)
    out = measured(noisy + 1, probability, noisy)
    np.testing.assert_array_equal(out > 0, noisy > 0)
    np.testing.assert_allclose(out[rim], noisy[rim] + 1)


def test_a_doubted_pixel_never_jumps_to_another_surface() -> None:
    noisy = head_before_wall()
    ring = rings((noisy > 0) & (noisy < 1200), 1)[0]
    depth = np.where(ring, WALL_MM, noisy).astype(np.float32)
    out = measured(depth, np.where(ring, 0.2, 0.9).astype(np.float32), noisy)
    np.testing.assert_array_equal(out[ring], noisy[ring])


def test_mid_air_pixels_are_dropped_only_where_the_network_doubts() -> None:
    noisy = head_before_wall()
    ring = rings((noisy == 0) | (noisy > 1200), 1)[0] & (noisy > 0)
    flying = np.zeros_like(ring)
    flying[np.nonzero(ring)[0][::7], np.nonzero(ring)[1][::7]] = True
    noisy[flying] = 0.5 * (HEAD_MM + 90 + WALL_MM)
    certain = np.where(noisy > 0, 0.99, 0.01).astype(np.float32)
    doubted = np.where(flying, 0.3, certain).astype(np.float32)
    assert flying.sum() > 20
    assert not measured(noisy, doubted, noisy)[flying].any()
    assert measured(noisy, certain, noisy)[flying].all()
    assert (measured(noisy, doubted, noisy) > 0)[~flying & (noisy > 0)].all()


def test_unlikely_pixels_are_dropped_beside_holes_alone() -> None:
    noisy = head_before_wall()
    noisy[noisy > 1200] = 0  # nothing behind the head
    *near, far = rings(noisy > 0, BESIDE_PX + 1)
    beside = np.any(near, axis=0)
    probability = np.where(noisy > 0, 0.99, 0.01).astype(np.float32)
    probability[beside | far] = 0.1
    out = measured(noisy, probability, noisy)
    np.testing.assert_array_equal(out == 0, (noisy == 0) | beside)
    # A probability of 0 is the safeguards', who doubt which surface it is; 0.4 is no strong doubt.
    for kept in (0.0, 0.4):
        probability[near[0]] = kept
        assert (measured(noisy, probability, noisy) > 0)[near[0]].all()


def test_a_plane_that_the_network_doubts_as_a_whole_is_kept() -> None:
    noisy = np.full((40, 50), 3000, np.float32)
    out = measured(noisy, np.full_like(noisy, 0.2), noisy)
    np.testing.assert_array_equal(out, noisy)


@pytest.mark.parametrize(
    ("rows", "columns", "closes"),
    [
        (slice(10, 11), slice(12, 13), True),
        (slice(10, 12), slice(12, 14), True),
        (slice(10, 12), slice(12, 30), True),  # a long gap, 2 px wide
        (slice(5, 30), slice(20, 21), True),
        (slice(10, 13), slice(12, 15), False),
        (slice(0, 2), slice(12, 14), False),  # open to the border
    ],
)
def test_holes_of_at_most_two_pixels_are_closed(rows: slice, columns: slice, closes: bool) -> None:
    y, x = np.mgrid[:40, :50].astype(np.float32)
    surface = 900 + 4 * x + 2 * y
    noisy = surface.copy()
    noisy[rows, columns] = 0
    sure = np.full_like(noisy, 0.99)
    out = measured(surface, sure, noisy)
    assert (out[rows, columns] > 0).all() == closes
    assert (out[rows, columns] > 0).any() == closes
    doubt = np.where(noisy > 0, 0.99, 0.4).astype(np.float32)
    assert not measured(surface, doubt, noisy)[rows, columns].any()


def test_a_gap_between_two_surfaces_stays_open() -> None:
    noisy = np.full((40, 50), HEAD_MM, np.float32)
    noisy[:, 26:] = WALL_MM
    noisy[4:36, 24:26] = 0  # 2 px wide, enclosed
    depth = np.where(noisy > 0, noisy, HEAD_MM).astype(np.float32)
    assert not measured(depth, np.ones_like(noisy), noisy)[4:36, 24:26].any()
    noisy[:, 26:] = HEAD_MM
    wrong = np.where(noisy > 0, noisy, WALL_MM).astype(np.float32)
    assert not measured(wrong, np.ones_like(noisy), noisy)[4:36, 24:26].any()


def test_no_pixel_appears_in_a_shadow() -> None:
    noisy = head_before_wall()
    noisy[10:30, 60:100] = 0
    rng = np.random.default_rng(0)
    probability = np.where(noisy > 0, 0.9, rng.random(noisy.shape)).astype(np.float32)
    depth = np.where(noisy > 0, noisy, WALL_MM).astype(np.float32)
    hard = composed(Denoised(depth, probability), noisy, "hard")
    valid = (hard > 0).astype(np.float32)
    neighbours = cv2.filter2D(valid, -1, np.ones((3, 3)), borderType=0) - valid
    assert ((valid > 0) & (neighbours < 3) & (noisy == 0)).sum() > 20
    assert not measured(depth, probability, noisy)[noisy == 0].any()


def test_a_networks_probability_is_cut_to_0_and_1() -> None:
    """A runtime's sigmoid returned more than 1 in a real frame, which was refused."""
    noisy = head_before_wall() + np.random.default_rng(0).normal(0, 2, (100, 120))
    noisy = np.where(head_before_wall() > 0, noisy, 0).astype(np.float32)

    class Network(Runs):
        def __call__(self, stack: Depth) -> dict[str, Depth]:
            above = np.nextafter(np.float32(1), np.float32(2))
            return {"depth_mm": stack[0], "probability": np.full_like(stack[0], above)}

    denoiser = Denoiser("net", NetworkFunction(Network(), "net"))
    assert denoiser.estimate(noisy[None].astype(np.float32)).valid.max() == 1
