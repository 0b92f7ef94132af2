"""Networks run only where there is depth, and with --around face near the nearest head alone."""

from pathlib import Path

import numpy as np
import pytest

from glsim import load_settings, simulate
from glsim.cli import main
from glsim.core.array_types import Depth
from glsim.core.errors import ConfigError
from glsim.core.files.png import encode_png, read_image
from glsim.denoise.registry import load_denoiser
from glsim.networks.record import AROUND_PX
from glsim.networks.tiles import GRID_PX, box_around, head_box


def head(wall_mm: float | None = None, distance_mm: float = 900.0, seed: int = 4) -> Depth:
    """A head in a whole frame of a Kinect V2, without or with a wall."""
    scene = {} if wall_mm is None else {"scene": {"wall_mm": wall_mm}}
    overrides = {"sensor": "kinect-v2-fankhauser", "seed": seed}
    overrides |= {"pose": {"distance_mm": distance_mm}, **scene}
    source = {"subjects": 1, "frames_per_subject": 1}
    (frame,) = simulate(load_settings(overrides=overrides, source=source))
    return frame.noisy.astype(np.float32)


def test_boxes_lie_on_the_grid_and_end_at_the_frame() -> None:
    mask = np.zeros((424, 512), np.bool_)
    assert box_around(mask) is None
    mask[200:230, 300] = True
    rows, columns = box_around(mask) or (slice(0), slice(0))
    assert rows.start % GRID_PX == columns.start % GRID_PX == 0
    assert (rows.stop - rows.start) % GRID_PX == (columns.stop - columns.start) % GRID_PX == 0
    assert rows.start <= 200 - AROUND_PX
    assert rows.stop >= 230 + AROUND_PX
    mask[423, 511] = True
    assert (box_around(mask) or rows)[0].stop == 424


@pytest.mark.parametrize("network", ["face", "face-stereo", "face-video"])
def test_a_network_around_depth_gives_what_it_gives_on_the_whole_frame(
    network: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = head()
    frames = np.stack([head(seed=5), frame]) if network == "face-video" else frame[None]
    near = load_denoiser(network).estimate(frames, len(frames) - 1)
    monkeypatch.setattr("glsim.networks.network.box_around", lambda *_: None)
    whole = load_denoiser(network).estimate(frames, len(frames) - 1)
    np.testing.assert_allclose(near.valid, whole.valid, atol=1e-3)
    some = frame > 0
    np.testing.assert_allclose(near.depth_mm[some], whole.depth_mm[some], atol=0.01)


def test_with_the_mirror_image_left_and_right_are_treated_alike() -> None:
    frame = head(1400.0)
    some = frame > 0
    unlike = []
    for spec in ("face", "face:mirror=1"):
        denoiser = load_denoiser(spec)
        depth_mm, mirrored_mm = (
            denoiser.estimate(noisy[None]).depth_mm for noisy in (frame, frame[:, ::-1].copy())
        )
        unlike.append(np.mean(np.abs(depth_mm - mirrored_mm[:, ::-1])[some] > 0.01))
    assert unlike[0] > 0.1, "walls are held to planes"
    assert unlike[1] < 0.001, "but for pixels of which the mirror image chooses another surface"


@pytest.mark.parametrize(
    ("wall_mm", "distance_mm"), [(None, 900.0), (1400.0, 900.0), (2500.0, 1300.0)]
)
def test_the_nearest_head_is_found(wall_mm: float | None, distance_mm: float) -> None:
    depth = head(wall_mm, distance_mm)
    box = head_box(depth)
    assert box is not None
    # The head's centre is on the optical axis: its top lies above, its chin below the middle.
    rows, columns = box
    assert rows.start < 200 < 224 < rows.stop
    assert columns.start < 246 < 266 < columns.stop
    side = 365 * 280 / distance_mm + 2 * 32 + 2 * GRID_PX
    assert rows.stop - rows.start <= side
    assert columns.stop - columns.start <= side


def test_there_is_no_head_in_noise_or_nothing() -> None:
    assert head_box(np.zeros((424, 512), np.float32)) is None
    speckles = np.random.default_rng(0).uniform(500, 4000, (424, 512)).astype(np.float32)
    assert head_box(speckles) is None


@pytest.mark.parametrize("spec", ["face", "face-video", "masked_gaussian"])
def test_the_head_is_denoised_and_the_rest_stays(spec: str) -> None:
    depth = head(1400.0)
    box = head_box(depth)
    assert box is not None
    result = load_denoiser(spec, around="face")(depth).depth_mm
    outside = np.ones(depth.shape, np.bool_)
    outside[box] = False
    np.testing.assert_array_equal(result[outside], depth[outside])
    inner = np.s_[190:235, 236:276]
    whole = load_denoiser(spec)(depth).depth_mm
    assert np.abs(whole - depth)[inner].mean() > 0.5
    np.testing.assert_allclose(result[inner], whole[inner], atol=0.15)


def test_the_command_and_what_it_refuses(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    depth = head(1400.0)
    Path("a.png").write_bytes(encode_png(depth.astype(np.uint16)))
    command = ["denoise", "a.png", "-o", "b.png", "-d", "masked_gaussian", "--out-unit-mm", "1"]
    assert main([*command, "--around", "face"]) == 0
    changed = read_image(Path("b.png")) != read_image(Path("a.png"))
    assert 0.01 < changed.mean() < 0.2
    capsys.readouterr()
    assert main([*command, "--around", "hand"]) == 2
    assert "--around hand" in capsys.readouterr().err
    with pytest.raises(ConfigError, match="--around hand"):
        load_denoiser("face", around="hand")
