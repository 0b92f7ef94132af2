"""``scripts.model_card`` makes a row of the model card's table."""

from pathlib import Path

import pytest

from scripts import model_card


@pytest.mark.long
def test_a_row_has_the_metrics_of_networks_and_filters(tmp_path: Path) -> None:
    methods = ["noisy", "face", "face-stereo", "guided:radius=1,epsilon_mm=5"]
    small = ["source.subjects=2", "source.frames_per_subject=2", "output.crop=64"]
    means = model_card.scored(tmp_path, "kinect-v2", [*small, "split=[0, 0, 1]"], methods)
    assert set(means) >= set(methods)
    raw, own = (tuple(map(float, means[name].split(" / "))) for name in ("noisy", "face"))
    assert own[0] < raw[0]
    assert own[1] < 0.9 * raw[1]
    assert raw[2] == 0, "raw frames lose nothing"
