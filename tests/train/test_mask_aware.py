"""The mask-aware wrapper: initial output, features, and independence of holes and walls."""

import pytest
import torch
from torch import Tensor

from glsim.core.errors import ConfigError
from glsim.train.models.features import FILTERS, OTHER_CHANNELS, FilterName, depth_features
from glsim.train.models.mask_aware import MaskAware, calibrate
from glsim.train.models.registry import build_model
from tests.support.networks import build, frames, parts

BACKBONES = ("dncnn", "small_unet")


def untrained(uncertainty: bool = True, surfaces: bool = False) -> MaskAware:
    spec = {"kind": "small_unet", "width": 8, "scales": 3}
    own = {"uncertainty": uncertainty, "surfaces": surfaces}
    model = build_model({"kind": "mask_aware", "backbone": spec} | own)
    assert isinstance(model, MaskAware)
    return model.eval()


def face_and_wall(wall_mm: float) -> Tensor:
    """A bump at 0.7 m, 60 px wide, with 2 mm of noise, before a wall (0 for none)."""
    y, x = torch.meshgrid(torch.arange(96.0), torch.arange(96.0), indexing="ij")
    radius = torch.hypot(x - 48, y - 48)
    noise = 2.0 * torch.randn(96, 96, generator=torch.Generator().manual_seed(1))
    face = 700.0 + radius.square() / 30 + noise
    return torch.where(radius < 30, face, wall_mm)[None, None]


@pytest.mark.parametrize("surfaces", [False, True])
def test_it_starts_from_the_frame_as_measured(surfaces: bool) -> None:
    noisy_mm = frames()
    prediction = untrained(surfaces=surfaces)(noisy_mm)
    valid = noisy_mm > 0
    assert torch.equal(prediction.depth_mm[valid], noisy_mm[valid])
    assert torch.equal(prediction.hard_mm(), noisy_mm)
    assert torch.equal(prediction.valid_logit.abs(), torch.full_like(noisy_mm, 3.0))
    torch.testing.assert_close(prediction.log_sigma.exp(), torch.full_like(noisy_mm, 1.65))


def test_a_shift_in_depth_shifts_the_result_and_nothing_else() -> None:
    noisy_mm = frames()
    shifted = torch.where(noisy_mm > 0, noisy_mm + 100.0, 0.0)
    model = build("masked", "small_unet").eval()
    with torch.no_grad():
        one, other = model(noisy_mm), model(shifted)
    torch.testing.assert_close(other.depth_mm - 100.0, one.depth_mm, rtol=0, atol=0.01)


@pytest.mark.parametrize("backbone", BACKBONES)
def test_no_weights_move_a_surface_as_a_whole(backbone: str) -> None:
    model = build("masked", backbone).eval()
    torch.manual_seed(1)
    noisy_mm = 900.0 + 2.0 * torch.randn(1, 1, 240, 240)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(0.05 * torch.randn_like(parameter))
        moved_mm = (model(noisy_mm).depth_mm - noisy_mm)[..., 40:200, 40:200]
    assert moved_mm.abs().mean() > 0.02  # it does correct pixels
    assert abs(float(moved_mm.mean())) < 0.1 * float(moved_mm.abs().mean())


@pytest.mark.parametrize("backbone", BACKBONES)
def test_the_distance_of_a_wall_does_not_change_the_face(backbone: str) -> None:
    inside = (..., slice(36, 60), slice(36, 60))
    model = build("masked", backbone).eval()
    with torch.no_grad():
        here, there = model(face_and_wall(1500.0)), model(face_and_wall(1600.0))
    torch.testing.assert_close(here.depth_mm[inside], there.depth_mm[inside], rtol=0, atol=1.0)


@pytest.mark.parametrize("wrapper", ["uncertain", "surfaces"])
@pytest.mark.parametrize("backbone", BACKBONES)
def test_a_crop_is_treated_as_within_its_frame(wrapper: str, backbone: str) -> None:
    model = build(wrapper, backbone).eval()
    frame = frames(1, 160, 176)
    top, left, size, margin = 16, 24, 128, 60  # features see 24 px, the U-Net of 3 scales 28 more
    with torch.no_grad():
        whole = parts(model, frame)
        crop = parts(model, frame[..., top : top + size, left : left + size])
    for big, small in zip(whole, crop, strict=True):
        big = big[..., top + margin : top + size - margin, left + margin : left + size - margin]
        small = small[..., margin:-margin, margin:-margin]
        torch.testing.assert_close(small, big, rtol=0, atol=2e-3)


@pytest.mark.parametrize("wrapper", ["uncertain", "surfaces"])
@pytest.mark.parametrize("backbone", [*BACKBONES, "unet", "restormer"])
def test_frames_without_depth_give_numbers(wrapper: str, backbone: str) -> None:
    model = build(wrapper, backbone)
    empty = torch.zeros(1, 1, 40, 40)
    single = empty.clone()
    single[..., 20, 20] = 900.0
    for frame in (empty, single):
        prediction = parts(model, frame)
        sum(part.mean() for part in prediction).backward()
        for value in (*prediction, *(parameter.grad for parameter in model.parameters())):
            assert value is None or value.isfinite().all()
    start = untrained()(empty)
    assert not start.hard_mm().any()


@pytest.mark.parametrize("wrapper", ["masked", "surfaces"])
@pytest.mark.parametrize("backbone", BACKBONES)
def test_what_is_in_a_hole_is_not_looked_at(wrapper: str, backbone: str) -> None:
    model = build(wrapper, backbone).eval()
    clean = frames()
    with torch.no_grad():
        expected = model(clean)
        for code in (torch.nan, -5.0, -torch.inf):
            garbage = torch.where(clean > 0, clean, code)
            for one, other in zip(expected, model(garbage), strict=True):
                assert one is other is None or torch.equal(one, other)


@pytest.mark.parametrize("filters", [FILTERS[:1], FILTERS[1::2], ("guided_1", "slopes")])
def test_fewer_filters_are_the_same_filters(filters: tuple[FilterName, ...]) -> None:
    """A filter's correction, mm, stays the same when other filters are left out."""
    every, some = depth_features(frames()), depth_features(frames(), filters)
    corrections_mm = every.bands_mm.cumsum(1)
    for place, name in enumerate(filters):
        torch.testing.assert_close(
            some.bands_mm[:, : place + 1].sum(1), corrections_mm[:, FILTERS.index(name)]
        )
    assert some.channels.shape[1] == len(filters) + OTHER_CHANNELS
    assert torch.equal(some.channels[:, len(filters) :], every.channels[:, len(FILTERS) :])


@pytest.mark.parametrize("surfaces", [False, True])
def test_calibration_sets_and_resets_the_factor(surfaces: bool) -> None:
    model = untrained(surfaces=surfaces)
    clean = torch.full((2, 1, 64, 64), 900.0)
    clean[..., :20] = 0.0
    noise = torch.randn(clean.shape, generator=torch.Generator().manual_seed(0))
    noisy = torch.where(clean > 0, clean + 3.3 * noise, 0.0)
    noisy[..., 30:33, 30:40] = 0.0  # holes that the model does not call depth do not count
    model.train()
    assert calibrate(model, [(noisy, clean)]) == pytest.approx(2.0, rel=0.05)
    assert model.training
    assert calibrate(model, [(noisy, clean)]) == pytest.approx(2.0, rel=0.05)  # not of itself
    torch.testing.assert_close(
        model(noisy).log_sigma.exp(), torch.full_like(noisy, 3.3), rtol=0.05, atol=0
    )
    copy = untrained(surfaces=surfaces)
    copy.load_state_dict(model.state_dict())
    assert copy.sigma_scale == model.sigma_scale


def test_calibration_needs_something_to_fit() -> None:
    frame = torch.full((1, 1, 16, 16), 900.0)
    with pytest.raises(ConfigError, match="set uncertainty = true"):
        calibrate(untrained(uncertainty=False), [(frame, frame)])
    with pytest.raises(ConfigError, match="no finite errors"):
        calibrate(untrained(), [(frame, torch.zeros_like(frame))])
    with pytest.raises(ConfigError, match="no finite errors"):
        calibrate(untrained(), [(frame, frame)])
