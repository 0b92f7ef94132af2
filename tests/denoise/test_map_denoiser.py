"""Denoising in memory: calibrated maps, and streams that hold their neighbours."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import glsim
from glsim.denoise import MapDenoiser, load, load_denoiser
from glsim.denoise.calibration import CalibratedFrames, DeviceCalibration
from glsim.denoise.interface import Depth
from glsim.denoise.loading import as_method
from glsim.errors import ConfigError
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.run import evaluate
from glsim.geometry.camera import Intrinsics
from glsim.sensors.sensor import SENSOR_FOLDER
from tests.support.eval_scenes import dome, noisy

CLEAN = dome()
FRAMES = [noisy(CLEAN, seed) for seed in range(5)]


class Mean:
    """The mean of the frame and two earlier ones; remembers what it was given."""

    before, after = 2, 0

    def __init__(self) -> None:
        self.seen: list[Depth] = []

    def __call__(self, depth: Depth, valid: np.ndarray, now: int) -> tuple[Depth, np.ndarray]:
        assert now == len(depth) - 1
        self.seen = list(depth)
        return depth.mean(axis=0), valid[now]


def test_a_stream_gives_each_frame_those_before_it() -> None:
    mean = Mean()
    stream = MapDenoiser(as_method("mean", mean)).stream()
    for number, frame in enumerate(FRAMES):
        depth_mm, valid = stream.push(frame)
        first = max(0, number - 2)
        np.testing.assert_array_equal(mean.seen, FRAMES[first : number + 1])
        expected = np.mean(FRAMES[first : number + 1], axis=0)
        np.testing.assert_allclose(depth_mm, np.where(frame > 0, expected, 0), rtol=1e-6)
        np.testing.assert_array_equal(valid, depth_mm > 0)
    stream.reset()
    stream.push(FRAMES[0])
    assert len(mean.seen) == 1


def test_a_frame_of_another_size_begins_a_new_sequence() -> None:
    mean = Mean()
    stream = MapDenoiser(as_method("mean", mean)).stream()
    stream.push(FRAMES[0])
    stream.push(FRAMES[1][:20])
    assert [frame.shape[0] for frame in mean.seen] == [20]
    stream.push(FRAMES[2][:20])
    assert len(mean.seen) == 2


def test_a_frame_that_is_refused_is_not_held_and_buffers_may_be_reused() -> None:
    mean = Mean()
    stream = MapDenoiser(as_method("mean", mean)).stream()
    buffer = FRAMES[0].copy()
    stream.push(buffer)
    buffer[:] = FRAMES[1]  # as a camera's driver does
    with pytest.raises(ConfigError, match="finite"):
        stream.push(np.full_like(buffer, np.nan))
    with pytest.raises(ConfigError, match="infrared of shape"):
        stream.push(buffer, buffer[:5])
    stream.push(buffer, infrared=buffer)
    np.testing.assert_array_equal(mean.seen, FRAMES[:2])


def test_a_stream_of_a_filter_with_later_frames_is_causal() -> None:
    denoiser = load_denoiser("temporal_median")
    stream = denoiser.stream()
    for number, frame in enumerate(FRAMES):
        stack = np.stack(FRAMES[max(0, number - 1) : number + 1])
        depth_mm, valid = load("temporal_median")(stack, len(stack) - 1)
        found = stream.push(frame)
        np.testing.assert_array_equal(found.valid, np.logical_and(valid, depth_mm > 0))
        np.testing.assert_array_equal(found.depth_mm, np.where(valid, depth_mm, 0))


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
    whole = glsim.load_sensor("kinect-v2").rig.intrinsics
    crop = whole.cropped(200, 100, 128, 96)
    found = denoiser(frame[100:196, 200:328], intrinsics=crop)
    np.testing.assert_array_equal(found.depth_mm, depth_mm[100:196, 200:328])
    stream = denoiser.stream(intrinsics=crop)
    again = stream.push(frame[100:196, 200:328])
    np.testing.assert_array_equal(again.depth_mm, found.depth_mm)


@pytest.mark.parametrize(
    ("crop", "words"),
    [
        (None, "whole images, or crops in a data set"),
        (Intrinsics(128, 96, 365.456, 365.456, 54.9, 105.395), "no whole number of pixels"),
        (Intrinsics(128, 96, 365.456, 365.456, 254.878, -200.605), "not within"),
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
    with pytest.raises(ConfigError, match="holds neither a map"):
        load_denoiser("noisy", device=tmp_path / "plain.toml")
    with pytest.raises(ConfigError, match=r"give the sensor file"):
        load_denoiser("noisy", device="kinect-v2")
    with pytest.raises(ConfigError, match="missing"):
        load_denoiser("noisy", device=tmp_path / "missing.toml")


def test_a_scoring_calibrates_the_input_of_all_denoisers(
    tmp_path: Path, pattern_mm: np.ndarray
) -> None:
    from glsim.files.png import encode_png

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
    assert isinstance(frames, CalibratedFrames)
    assert len(frames) == 2
    assert frames.key(1).frame == 1
    assert DeviceCalibration(file).parts == ("fixed pattern",)
