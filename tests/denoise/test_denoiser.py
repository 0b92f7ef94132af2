"""One denoiser for maps in memory: composites, streams that hold neighbours, devices, inputs."""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import glsim
from glsim.core.array_types import Depth
from glsim.core.camera import Intrinsics
from glsim.core.errors import ConfigError, DenoiserError
from glsim.core.files.png import encode_png
from glsim.denoise.calibration import DeviceCalibration
from glsim.denoise.denoiser import Denoiser
from glsim.denoise.registry import load_denoiser
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.evaluate import evaluate
from glsim.sensors.sensor import SENSOR_FOLDER
from tests.support import checkpoint_stand_in
from tests.support.eval_scenes import dome, noisy

FRAMES = [noisy(dome(), seed) for seed in range(5)]
NOISY = FRAMES[0]


class Mean:
    """The mean of the frame and two earlier ones; remembers what it was given."""

    before, after = 2, 0

    def __init__(self) -> None:
        self.seen: list[Depth] = []

    def __call__(self, depth: Depth, valid: np.ndarray, now: int) -> tuple[Depth, np.ndarray]:
        assert now == len(depth) - 1
        self.seen = list(depth)
        return depth.mean(axis=0), valid[now]


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.uint16])
def test_one_map_is_a_sequence_of_one(dtype: type) -> None:
    for spec in ("masked_median", "temporal_median", "quadric:sigma_px=2"):
        denoiser = load_denoiser(spec)
        depth_mm, valid = denoiser(NOISY.astype(dtype))
        expected = denoiser.estimate(NOISY[None])
        np.testing.assert_array_equal(depth_mm, expected.composite("measured"))
        np.testing.assert_array_equal(valid, expected.valid)
        assert valid.dtype == np.bool_


def test_a_probability_becomes_a_mask_by_a_composite(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "glsim.denoise.inference", checkpoint_stand_in)
    path = tmp_path / "best.pt"
    path.write_text(json.dumps({"gain": 0.2, "soft": True}))
    noisy_mm: Any = NOISY.astype(np.uint16)
    raw = load_denoiser(str(path), composite=None)(noisy_mm)
    np.testing.assert_allclose(raw.valid, np.where(NOISY > 0, 0.75, 0.25))
    estimate = load_denoiser(str(path)).estimate(noisy_mm[None])
    for composite, expected in estimate.composites().items():
        depth_mm, valid = load_denoiser(str(path), composite=composite)(noisy_mm)
        np.testing.assert_array_equal(depth_mm, expected)
        np.testing.assert_array_equal(valid, expected > 0)
    default = load_denoiser(str(path))(noisy_mm)
    np.testing.assert_array_equal(default.depth_mm, estimate.composite("measured"))
    with pytest.raises(ConfigError, match="did you mean 'measured'"):
        load_denoiser(str(path), composite="mesured")


@pytest.mark.parametrize(
    ("depth", "words"),
    [
        (NOISY[None], r"shape \(H, W\)"),
        (NOISY > 0, "float or integer"),
        (np.full_like(NOISY, np.nan), "finite"),
        (-NOISY, "at least 0"),
        ("a.png", r"shape \(H, W\) .* not a str"),
        (NOISY[:0], r"not \(0, "),
        (np.where(NOISY.max() == NOISY, 11, NOISY / 1000.0), r"in metres\?"),
    ],
)
def test_what_is_no_depth_map_is_refused(depth: Any, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load_denoiser("median")(depth)


def test_a_stream_gives_each_frame_those_before_it() -> None:
    mean = Mean()
    denoiser = Denoiser("mean", mean)
    for number, frame in enumerate(FRAMES):
        depth_mm, valid = denoiser.push(frame)
        first = max(0, number - 2)
        np.testing.assert_array_equal(mean.seen, FRAMES[first : number + 1])
        expected = np.mean(FRAMES[first : number + 1], axis=0)
        np.testing.assert_allclose(depth_mm, np.where(frame > 0, expected, 0), rtol=1e-6)
        np.testing.assert_array_equal(valid, depth_mm > 0)
    denoiser.push(FRAMES[1][:20])  # another size begins a new sequence
    assert [frame.shape[0] for frame in mean.seen] == [20]
    denoiser.reset()
    denoiser.push(FRAMES[2][:20])
    assert len(mean.seen) == 1


def test_a_frame_that_is_refused_is_not_held_and_buffers_may_be_reused() -> None:
    mean = Mean()
    denoiser = Denoiser("mean", mean)
    buffer = NOISY.copy()
    denoiser.push(buffer)
    buffer[:] = FRAMES[1]  # as a camera's driver does
    with pytest.raises(ConfigError, match="finite"):
        denoiser.push(np.full_like(buffer, np.nan))
    with pytest.raises(ConfigError, match="infrared of shape"):
        denoiser.push(buffer, buffer[:5])
    denoiser.push(buffer, infrared=buffer)
    np.testing.assert_array_equal(mean.seen, FRAMES[:2])


def test_a_stream_of_a_filter_with_later_frames_is_causal() -> None:
    denoiser = load_denoiser("temporal_median")
    for number, frame in enumerate(FRAMES):
        stack = np.stack(FRAMES[max(0, number - 1) : number + 1])
        expected = denoiser.estimate(stack, len(stack) - 1).composite("measured")
        np.testing.assert_array_equal(denoiser.push(frame).depth_mm, expected)


@pytest.mark.parametrize(
    ("result", "words"),
    [
        (lambda d, v: d, r"must return \(depth_mm, valid\)"),
        (lambda d, v: (d, v, d), r"must return \(depth_mm, valid\)"),
        (lambda d, v: (d[1:], v), r"depth_mm of shape"),
        (lambda d, v: (d / 1000, v), r"returned metres\? return millimetres"),
        (lambda d, v: (d, v + 1.5), r"must lie in \[0, 1\]"),
        (lambda d, v: (d, v.astype(int)), "bool, or float"),
    ],
)
def test_what_a_function_must_return(result: Any, words: str) -> None:
    with pytest.raises(DenoiserError, match=words):
        Denoiser("mine", result)(NOISY)
    with pytest.raises(DenoiserError, match="is no function"):
        Denoiser("mine", result and 3)  # type: ignore[arg-type]


def device(folder: Path, pattern_mm: np.ndarray) -> Path:
    np.save(folder / "pattern.npy", pattern_mm.astype(np.float32))
    text = (SENSOR_FOLDER / "kinect-v2.toml").read_text()
    text = text.replace("[rig]\n", '[rig]\nfixed_pattern_map = "pattern.npy"\n', 1)
    (folder / "device.toml").write_text(text)
    return folder / "device.toml"


@pytest.fixture
def pattern_mm() -> np.ndarray:
    return np.random.default_rng(1).normal(0, 1, (424, 512)).astype(np.float32)


def test_the_pattern_of_a_device_is_subtracted_before_denoising(
    tmp_path: Path, pattern_mm: np.ndarray
) -> None:
    denoiser = load_denoiser("noisy", device=device(tmp_path, pattern_mm))
    frame = np.full((424, 512), 1000, np.uint16)
    frame[5] = 0
    depth_mm, valid = denoiser(frame)
    np.testing.assert_allclose(depth_mm, np.where(frame > 0, 1000 - pattern_mm, 0), atol=1e-3)
    np.testing.assert_array_equal(valid, frame > 0)
    crop = glsim.load_sensor("kinect-v2").rig.intrinsics.cropped(200, 100, 128, 96)
    for found in (denoiser, denoiser.push):
        part = found(frame[100:196, 200:328], intrinsics=crop)
        np.testing.assert_array_equal(part.depth_mm, depth_mm[100:196, 200:328])


@pytest.mark.parametrize(
    ("crop", "words"),
    [
        (None, "whole images, or crops in a data set"),
        (Intrinsics(128, 96, 365.456, 365.456, 54.9, 105.395), "another camera"),
        (Intrinsics(128, 96, 365.456, 365.456, 254.878, -200.605), "another camera"),
        (Intrinsics(128, 96, 570.0, 570.0, 54.878, 105.395), "another camera"),
    ],
)
def test_maps_that_are_no_part_of_the_device_are_refused(
    tmp_path: Path, pattern_mm: np.ndarray, crop: Intrinsics | None, words: str
) -> None:
    denoiser = load_denoiser("noisy", device=device(tmp_path, pattern_mm))
    with pytest.raises(ConfigError, match=words):
        denoiser(np.full((96, 128), 900.0), intrinsics=crop)


def test_devices_that_measured_nothing_are_refused(tmp_path: Path) -> None:
    (tmp_path / "plain.toml").write_text((SENSOR_FOLDER / "kinect-v2.toml").read_text())
    for place, words in (
        (tmp_path / "plain.toml", "holds neither a map"),
        ("kinect-v2", "give the sensor file"),
        (tmp_path / "missing.toml", "missing"),
    ):
        with pytest.raises(ConfigError, match=words):
            load_denoiser("noisy", device=place)


def test_a_scoring_calibrates_the_input_of_all_denoisers(
    tmp_path: Path, pattern_mm: np.ndarray
) -> None:
    file = device(tmp_path, np.full_like(pattern_mm, 5.0))
    pairs = tmp_path / "pairs"
    pairs.mkdir()
    for number in range(2):
        for layer, depth in (("clean", 900), ("noisy", 905)):
            image = np.full((424, 512), depth, np.uint16)
            (pairs / f"{number:03d}_{layer}.png").write_bytes(encode_png(image))
    bias = {}
    for name, used in (("raw", None), ("calibrated", file)):
        job = ScoringJob(pairs, "test", ("noisy",), device=used)
        found = evaluate(job, tmp_path / "out", workers=1, baselines=False)
        bias[name] = found.summary.mean("noisy", "input_bias_mm")
    assert bias["raw"] == pytest.approx(5)
    assert bias["calibrated"] == pytest.approx(0, abs=1e-3)
    frames = ScoringJob(pairs, "test", ("noisy",), device=file).frames()
    assert frames.identity.endswith(DeviceCalibration(file).identity)
    assert (len(frames), frames.key(1).frame) == (2, 1)
    assert DeviceCalibration(file).parts == ("fixed pattern",)
