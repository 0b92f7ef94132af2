"""The files of settings of any depth camera differ in their rigs and distances only."""

from pathlib import Path

import numpy as np
import pytest

from glsim.core.reason import Reason
from glsim.sensors.sensor import sensor_of
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.pipeline import simulate

MEASURED = [reason for reason in Reason if reason.has_depth]
FOLDER = Path(__file__).parents[2] / "train" / "data"
FILES = ["any_camera.toml", "any_camera_320.toml", "any_camera_640.toml", "any_camera_1024.toml"]


def settings(name: str) -> Settings:
    few = ["source.subjects=1", "source.frames_per_subject=2", "devices=2"]
    return load_settings(FOLDER / name, few)


def test_one_camera_at_four_sizes() -> None:
    loaded = [settings(name) for name in FILES]
    rigs = [sensor_of(s).rig for s in loaded]
    assert [rig.intrinsics.width for rig in rigs] == [512, 320, 640, 1024]
    sides = {rig.emitter_m[0] > 0 for rig in rigs}
    assert sides == {True, False}
    assert all(0 < rig.baseline_m <= 0.075 for rig in rigs)
    for own in loaded:
        same = {"rig", "pose", "scene"}
        assert own.model_dump(exclude=same) == loaded[0].model_dump(exclude=same)


@pytest.mark.parametrize("name", FILES)
def test_frames_hold_a_face(name: str) -> None:
    layers = ("clean", "expected", "noisy", "infrared", "reason")
    first = list(simulate(settings(name), layers=layers))
    for frame in first:
        assert frame.noisy.shape == (128, 128)
        assert (frame.noisy > 0).mean() > 0.3
        assert ((frame.noisy > 0) == np.isin(frame.reason, MEASURED)).all()
        assert (frame.expected != frame.clean).any()
    assert first[0].parameters != first[1].parameters
