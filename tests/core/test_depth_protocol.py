"""Moving depth to 1 mm and back, and the record of it in data sets."""

from pathlib import Path

import numpy as np
import pytest

from glsim.core.depth_protocol import check_protocol, offset_to_nearest, stored_protocol
from glsim.core.errors import ConfigError
from glsim.core.units import add_offset, subtract_offset
from glsim.data.reader import open_dataset
from glsim.settings.schema import load_settings
from tests.support.moved_sets import write_domes


def test_the_nearest_point_comes_to_1_mm_and_goes_back() -> None:
    depth = np.array([[0, 812, 900.5], [830, 0, 812]], np.float32)
    offset = offset_to_nearest(depth)
    moved = subtract_offset(depth, offset)
    np.testing.assert_array_equal(moved, [[0, 1, 89.5], [19, 0, 1]])
    np.testing.assert_array_equal(add_offset(moved, offset), depth)


def test_noise_before_the_nearest_point_is_cut_off_and_stays_depth() -> None:
    seen = np.array([0, 805, 811.2, 813], np.float32)
    np.testing.assert_allclose(subtract_offset(seen, 811), [0, 1, 1, 2])
    assert offset_to_nearest(np.zeros((3, 3), np.float32)) == 0


def test_protocols_have_two_names() -> None:
    assert check_protocol(None) is None
    assert check_protocol("paper") == "paper"
    with pytest.raises(ConfigError, match=r"--protocol papr: .*paper"):
        check_protocol("papr")
    assert [stored_protocol(mm) for mm in (None, 1.0, 100.0)] == ["depth", "paper", "depth"]


def test_a_data_set_records_its_protocol_and_reads_as_measured(tmp_path: Path) -> None:
    sets = {name: open_dataset(write_domes(tmp_path / name, name)) for name in ("depth", "paper")}
    assert [data.protocol for data in sets.values()] == ["depth", "paper"]
    for measured, moved in zip(sets["depth"], sets["paper"], strict=True):
        offset_mm = moved.record["depth_offset_mm"]
        assert offset_mm == 899 + 10 * moved.record["index"]
        assert moved.clean_mm[moved.clean_mm > 0].min() == pytest.approx(1 + offset_mm)
        np.testing.assert_array_equal(moved.clean_mm, measured.clean_mm)
        np.testing.assert_array_equal(moved.noisy_mm, measured.noisy_mm)


@pytest.mark.long
def test_generate_takes_the_protocol(tmp_path: Path) -> None:
    from glsim.cli import main

    command = ["generate", "-o", str(tmp_path / "d"), "--subjects", "1"]
    command += ["--frames-per-subject", "1", "--set", "output.crop=64", "--workers", "1"]
    assert main([*command, "--set", "output.nearest_to_mm=1", "-q"]) == 0
    data = open_dataset(tmp_path / "d")
    assert data.protocol == "paper"
    pair = next(iter(data))
    offset_mm = pair.record["depth_offset_mm"]
    assert pair.clean_mm[pair.clean_mm > 0].min() == pytest.approx(1 + offset_mm)
    assert 600 < offset_mm < 900
    assert load_settings().output.nearest_to_mm is None
