"""FACS performances: pure functions, in range, neutral at both ends."""

import re

import numpy as np
import pytest

from glsim.faces.performance import CODES, performance_for, sequence_name, sequence_number

PERFORMANCES = [performance_for(3, f"p{s:04d}", n) for s in range(4) for n in range(20)]


def test_all_codes_come_before_one_is_repeated() -> None:
    codes = [performance_for(0, "p0000", n).code for n in range(len(CODES))]
    assert sorted(codes) == sorted(CODES)


@pytest.mark.parametrize("performance", PERFORMANCES)
def test_curves_rise_and_fall(performance) -> None:
    times = np.linspace(0.0, performance.duration_s, 400)
    for unit, curve in performance.curves.items():
        values = np.array([curve.at(time_s) for time_s in times])
        assert re.fullmatch(r"AU\d+(_[LR])?", unit)
        assert values.min() >= 0.0
        assert values.max() <= 1.0
        assert values[0] == 0.0
        assert values[-1] == 0.0
        steepest = 6.0 if unit.startswith("AU45") else 4.0  # of the peak, a tenth of the duration
        assert np.abs(np.diff(values)).max() < steepest * 10 / 400
    assert performance.at(0.0) == {}
    assert performance.at(performance.duration_s) == {}


@pytest.mark.parametrize("performance", PERFORMANCES)
def test_peak_is_the_peak(performance) -> None:
    assert 0.5 <= performance.duration_s <= 4.0
    at_peak = performance.at(performance.peak_s)
    for unit, curve in performance.curves.items():
        assert at_peak[unit] == pytest.approx(curve.peak, rel=0.02)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 30, 60])
def test_frame_times_include_the_peak(count: int) -> None:
    for performance in PERFORMANCES[:12]:
        times = performance.frame_times(count)
        assert len(times) == count
        assert performance.peak_s in times
        assert np.all(np.diff(times) > 0)
        assert times[0] >= 0
        assert times[-1] <= performance.duration_s


def test_sequence_names_are_path_safe_and_read_back() -> None:
    for number, performance in enumerate(PERFORMANCES):
        name = sequence_name(number, performance)
        assert re.fullmatch(r"[A-Za-z0-9_+-]+", name)
        assert sequence_number(name) == number
    with pytest.raises(ValueError, match="not a sequence name"):
        sequence_number("smile")
