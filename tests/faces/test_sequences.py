"""Frames of generated sequences: whole performances, or parts of them at a camera's rate."""

import numpy as np
import pytest

from glsim.core.errors import ConfigError
from glsim.faces import open_source
from glsim.faces.generated import PerformanceKeys
from glsim.faces.performance import performance_for
from glsim.settings.schema import load_settings


def test_frames_at_a_rate_are_parts_of_the_performances() -> None:
    keys = PerformanceKeys(3, "p0001", 50, 8, 30.0)
    starts = []
    for number, first in enumerate(range(0, 48, 8)):
        times = np.array([key.time_s for key in keys[first : first + 8]])
        assert len({key.sequence for key in keys[first : first + 8]}) == 1
        np.testing.assert_allclose(np.diff(times), 1 / 30)
        assert times[0] >= 0
        assert times[-1] <= performance_for(3, "p0001", number).duration_s
        starts.append(times[0])
    assert np.ptp(starts) > 0.2
    assert keys == PerformanceKeys(3, "p0001", 50, 8, 30.0)
    assert keys[:48] == PerformanceKeys(3, "p0001", 48, 8, 30.0)


def test_a_sequence_longer_than_the_performance_starts_with_it() -> None:
    keys = PerformanceKeys(3, "p0001", 100, 100, 30.0)
    assert keys[0].time_s == 0
    assert keys[-1].time_s == pytest.approx(3.3)


def test_settings_choose_length_and_rate_of_generated_sequences() -> None:
    tree = {"source": {"kind": "procedural", "frames_per_sequence": 5, "frames_per_second": 15}}
    settings = load_settings(overrides=tree)
    keys = open_source(settings.source[0], 0).frames("p0000", 6)
    assert keys[4].time_s - keys[3].time_s == pytest.approx(1 / 15)
    assert keys[5].sequence != keys[4].sequence
    with pytest.raises(ConfigError, match="folder has no such option"):
        load_settings(overrides={"source": {"kind": "folder", "frames_per_second": 30}})


@pytest.mark.parametrize("rate", [None, 30.0])
def test_keys_are_the_same_in_any_order(rate: float | None) -> None:
    keys = PerformanceKeys(3, "p0001", 50, 8, rate)
    whole = list(PerformanceKeys(3, "p0001", 50, 8, rate))
    assert len(keys) == len(whole) == 50
    assert [keys[number] for number in reversed(range(50))] == whole[::-1]
    assert keys[5:20:3] == whole[5:20:3]
    assert keys[-1] == whole[-1]
    assert PerformanceKeys(3, "p0001", 10**9, 8, rate)[10**9 - 1].frame == 7
    with pytest.raises(IndexError, match="it has 50 frames, not one at 50"):
        keys[50]
