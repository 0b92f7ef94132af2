"""Adapting a network to a camera by its noisy frames alone."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from glsim.cli import main
from glsim.core.array_types import Depth
from glsim.core.camera import Intrinsics
from glsim.core.depth_frame import DepthFrame, FrameKey
from glsim.core.errors import TrainError
from glsim.denoise.registry import load_denoiser
from glsim.train.adapt import MeasuredNoise, adapt

CAMERA = Intrinsics(width=128, height=128, fx=365.0, fy=365.0, cx=64.0, cy=64.0)


def recording(views: int, count: int = 2, moved_px: float = 0.0) -> list[DepthFrame]:
    """Make ``count`` frames of each of several slanted, wavy walls; the waves may move."""
    rng, frames = np.random.default_rng(1), []
    rows, columns = np.mgrid[:128, :128]
    for view in range(views):
        for number in range(count):
            waves = 2 * np.sin((rows + moved_px * number) / (4 + view))
            wall = 900 + 60 * view + (1 + view % 3) * columns + waves
            noise = cv2.GaussianBlur(rng.standard_normal(wall.shape), (0, 0), 0.9)
            depth: Depth = (wall + 1.2 * noise / noise.std()).astype(np.float32)
            key = FrameKey("wall", view, number)
            frames.append(DepthFrame(key, CAMERA, {"noisy_mm": depth}, step_mm=0.1))
    return frames


def test_drawn_noise_has_the_size_and_correlation_of_the_measured() -> None:
    noise = MeasuredNoise(recording(3), [(0, 1), (2, 3), (4, 5)])
    rng = np.random.default_rng(2)
    drawn = np.stack([noise.draw(np.full((64, 64), 1000, np.float32), rng) for _ in range(60)])
    assert drawn.std() == pytest.approx(1.2, rel=0.05)
    for lag in (1, 2):
        correlation = (drawn[..., lag:] * drawn[..., :-lag]).mean() / drawn.var()
        assert correlation == pytest.approx(np.exp(-(lag**2) / (4 * 0.9**2)), abs=0.05)


def test_frames_without_two_still_pairs_are_refused(tmp_path: Path) -> None:
    with pytest.raises(TrainError, match=r"2 of the 2 frames .* and 4 are needed"):
        adapt(recording(1), tmp_path / "mine.onnx", "face", 25)
    said: list[str] = []
    with pytest.raises(TrainError, match="nothing is written"):
        adapt(recording(1, 6, 2.0), tmp_path / "mine.onnx", "face", 1, announce=said.append)
    assert "from one frame to two: the scene moves slowly" in said[0]
    assert not (tmp_path / "mine.onnx").exists()


def test_a_wrong_name_of_the_output_is_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["adapt", "nothing", "-o", "mine.pt"]) == 2
    assert "-o mine.pt: the name must end in .onnx" in capsys.readouterr().err


@pytest.mark.long
def test_the_held_back_pair_comes_nearer_and_the_network_is_read_again(tmp_path: Path) -> None:
    out = tmp_path / "mine.onnx"
    done = adapt(recording(5), out, "face", 50, seed=3)
    assert done.after_mm < 0.99 * done.before_mm < done.raw_mm
    again = adapt(recording(5), tmp_path / "again.onnx", "face", 50, seed=3)
    assert again == done
    assert (tmp_path / "again.onnx").read_bytes() == out.read_bytes()
    assert load_denoiser(str(out))(recording(5)[0].measured_mm).valid.mean() > 0.95
