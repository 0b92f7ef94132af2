"""Test a data set of the real simulator: worker processes, files, reader."""

from pathlib import Path

import numpy as np
import pytest

from glsim.data.driver import generate
from glsim.data.reader import open_dataset
from glsim.data.verification import verify
from glsim.settings.schema import load_settings
from glsim.simulation.pipeline import simulate
from tests.support.dataset_fakes import contents


@pytest.mark.parametrize("format", ["png", pytest.param("webdataset", marks=pytest.mark.long)])
def test_any_workers_and_a_repair_give_the_same_bytes(tmp_path: Path, format: str) -> None:
    settings = load_settings(
        overrides={
            "source": {"kind": "procedural", "subjects": 4, "frames_per_subject": 5},
            "pose": {"yaw_deg": {"uniform": [-20, 20]}},
            "output": {"crop": 64, "format": format},
        }
    )
    one, two = tmp_path / "one", tmp_path / "two"
    generate(settings, one, workers=1)
    generate(settings, two, workers=2)
    assert contents(one) == contents(two)
    next(two.glob("train-*.tar" if format == "webdataset" else "train/*/*.png")).unlink()
    summary = generate(settings, two, workers=1)
    assert 0 < summary.rendered < 20
    assert contents(one) == contents(two)
    assert verify(two, deep=True) == []

    frames = {(frame.key.subject, frame.key.frame): frame for frame in simulate(settings)}
    for pair in open_dataset(two):
        frame = frames[pair.key.subject, pair.key.frame]
        np.testing.assert_array_equal(pair.clean_mm, frame.clean)
        np.testing.assert_array_equal(pair.noisy_mm, frame.noisy)
        assert pair.noisy_mm.any()
        assert pair.intrinsics == frame.intrinsics
