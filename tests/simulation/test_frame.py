"""Frames: encoding as integers, windows, masks, reasons."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from glsim.core.errors import ConfigError, DatasetError
from glsim.core.files.png import encode_png
from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.data.layer_images import decode_layer
from glsim.faces.face_source import FaceKey
from glsim.settings.schema import OutputSettings
from glsim.simulation.assembly import assemble_frame, reconcile_reasons
from glsim.simulation.frame import Frame, decode_normals, encode_normals
from tests.support.scenes import V2

WITH_DEPTH = [Reason.VALID, Reason.MOVED, Reason.GROWN]


def made(
    clean_mm: float = 900, noisy_mm: float = 905, crop: Rect | None = None, **output: object
) -> Frame:
    """A frame with a window of two pixels: one has the given depths, the other none."""
    window = Rect(100, 50, 2, 1)
    layers = {
        "clean": np.array([[clean_mm / 1000, 0]], np.float32),
        "depth": np.array([[noisy_mm / 1000, 0]], np.float32),
        "reason": np.zeros((1, 2), np.float32),
        "infrared": np.array([[70_000.4, 12.6]], np.float32),
    }
    return assemble_frame(
        layers,
        window,
        crop or Rect(0, 0, V2.width, V2.height),
        V2,
        OutputSettings.model_validate(output),
        key=FaceKey("s", "main", 0),
        source="test",
        seed=1,
    )


def test_a_frame_pastes_its_window_into_the_image() -> None:
    frame = made()
    for image, dtype in (
        (frame.clean, np.uint16),
        (frame.noisy, np.uint16),
        (frame.infrared, np.uint16),
        (frame.reason, np.uint8),
    ):
        assert image.shape == (V2.height, V2.width)
        assert image.dtype == dtype
    assert np.argwhere(frame.clean).tolist() == [[50, 100]]
    assert (frame.clean[50, 100], frame.noisy[50, 100]) == (900, 905)
    assert (frame.infrared[50, 100], frame.infrared[50, 101]) == (65535, 13)
    assert (frame.reason == Reason.NO_SURFACE).sum() == frame.reason.size - 1
    assert frame.image("noisy").tolist() == frame.noisy.tolist()
    with pytest.raises(ConfigError, match="no such layer 'nosy': did you mean 'noisy'"):
        frame.image("nosy")


def test_a_crop_moves_window_and_camera() -> None:
    frame = made(crop=Rect(90, 40, 64, 32))
    assert frame.window == Rect(10, 10, 2, 1)
    assert (frame.intrinsics.width, frame.intrinsics.height) == (64, 32)
    assert (frame.intrinsics.cx, frame.intrinsics.cy) == (V2.cx - 90, V2.cy - 40)
    assert np.argwhere(frame.clean).tolist() == [[10, 10]]
    assert made(crop=Rect(101, 40, 64, 32)).clean_m.shape == (1, 1)


def test_the_clean_mask_may_be_the_noisy_ones() -> None:
    assert made(900, 0).clean.max() == 900
    assert made(900, 0, clean_mask="as-noisy").clean.max() == 0
    assert made(900, 905, clean_mask="as-noisy").clean.max() == 900


def test_the_nearest_clean_point_may_be_shifted_to_a_depth() -> None:
    frame = made(900, 905, nearest_to_mm=100)
    assert (frame.clean.max(), frame.noisy.max()) == (100, 105)
    assert frame.depth_offset_mm == pytest.approx(800, abs=1e-3)
    near = made(900, 750, nearest_to_mm=100)  # would be below 0: keeps one unit
    assert (near.clean.max(), near.noisy.max()) == (100, 1)
    assert near.reason[50, 100] == Reason.VALID
    assert made(0, 0, nearest_to_mm=100).depth_offset_mm == 0


def explained(clean: float, noisy: float, code: float) -> Reason:
    arrays = (np.array([[value]], np.float32) for value in (clean, noisy, code))
    return Reason(int(reconcile_reasons(*arrays)[0, 0]))


@pytest.mark.parametrize("code", [*Reason, 13, 99, 200.4])
@pytest.mark.parametrize(("clean", "noisy"), list(itertools.product((0, 0.9), (0, 0.9))))
def test_reasons_agree_with_the_depth(clean: float, noisy: float, code: float) -> None:
    said = Reason(int(code)) if code <= max(Reason) else Reason.DROPPED
    found = explained(clean, noisy, code)
    assert found.has_depth == (noisy > 0)
    if noisy > 0:
        # A depth without a surface was grown; a code without depth becomes VALID.
        expected = said if said.has_depth else Reason.VALID
        assert found == (Reason.GROWN if expected == Reason.VALID and clean == 0 else expected)
    elif said.has_depth:
        assert found == (Reason.DROPPED if clean > 0 else Reason.NO_SURFACE)
    else:
        assert found == said


def test_every_reason_is_explained_and_drawn() -> None:
    from glsim.data.contact_sheet import _REASON_COLOURS

    assert [r for r in Reason if r.has_depth] == WITH_DEPTH
    assert sorted(Reason) == list(range(len(Reason)))
    assert set(_REASON_COLOURS) == set(Reason)
    assert all(r.help for r in Reason)


@given(
    st.tuples(*[st.integers(-5, 30)] * 2, *[st.integers(0, 30)] * 2),
    st.tuples(*[st.integers(-5, 30)] * 2, *[st.integers(0, 30)] * 2),
)
def test_intersections_hold_the_pixels_of_both(
    one: tuple[int, int, int, int], other: tuple[int, int, int, int]
) -> None:
    def pixels(rect: Rect) -> set[tuple[int, int]]:
        return {
            (x, y)
            for x in range(rect.left, rect.left + rect.width)
            for y in range(rect.top, rect.top + rect.height)
        }

    a, b = Rect(*one), Rect(*other)
    assert pixels(a.intersection(b)) == pixels(a) & pixels(b)
    if b.width and b.height:
        assert a.contains(b) == (pixels(b) <= pixels(a))


def test_normals_come_back_within_the_step_of_a_code() -> None:
    rng = np.random.default_rng(2)
    normals = rng.normal(size=(30, 40, 3))
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals[0, :3] = [[-1, 0, 0], [0, 1, 0], [0, 0, -1]]
    seen = rng.random((30, 40)) < 0.7
    seen[0, :3] = True
    codes = encode_normals(normals, seen)
    assert codes.dtype == np.uint16
    assert codes[0, 0].tolist() == [1, 32768, 32768]
    assert (codes.any(axis=-1) == seen).all()
    again = decode_layer(encode_png(codes), "normals", "a file")
    np.testing.assert_array_equal(again, codes)
    decoded = decode_normals(codes)
    np.testing.assert_allclose(decoded[seen], normals[seen], atol=3e-5)
    assert not decoded[~seen].any()


def test_channels_are_those_of_the_layer() -> None:
    grey, colour = np.zeros((4, 5), np.uint16), np.zeros((4, 5, 3), np.uint16)
    with pytest.raises(DatasetError, match="has 1 channels instead of three"):
        decode_layer(encode_png(grey), "normals", "a file")
    with pytest.raises(DatasetError, match="has 3 channels instead of one"):
        decode_layer(encode_png(colour), "noisy", "a file")
