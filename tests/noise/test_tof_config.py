"""Invalid time-of-flight sensors: one line says why."""

from __future__ import annotations

from pathlib import Path

import pytest

from glsim.core.errors import ConfigError
from glsim.noise.rig_checks import unambiguous_m
from glsim.sensors.sensor import SENSOR_FOLDER, load_sensor
from glsim.settings.distribution import Distribution


def changed(folder: Path, old: str, new: str) -> str:
    """A copy of the file of kinect-v2 with ``old`` replaced by ``new``."""
    text = (SENSOR_FOLDER / "kinect-v2.toml").read_text(encoding="utf-8")
    assert old in text
    (folder / "sensor.toml").write_text(text.replace(old, new), encoding="utf-8")
    return str(folder / "sensor.toml")


def test_the_kinects_frequencies_reach_18_75_m() -> None:
    assert unambiguous_m((80, 16, 120)) == pytest.approx(18.75)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[80, 16, 120]", "[]", r"rig.modulation_mhz \[\]: give three frequencies above 1 MHz"),
        ("[80, 16, 120]", "[80, 16, 0.5]", "give three frequencies above 1 MHz"),
        ("[80, 16, 120]", "[80, 32, 120]", "first must be a whole multiple of the second"),
        ("[80, 16, 120]", "[80, 80, 120]", "first must be a whole multiple of the second"),
        ("[80, 16, 120]", "[80, 20, 120]", "the phases repeat after 7.50 m, nearer than"),
        ("[80, 16, 120]", "[100, 50, 150]", "the phases repeat after 3.00 m, nearer than"),
        ("supersample = 3", "supersample = 2", "supersample 2 must be odd"),
        ("supersample = 3", "supersample = 7", "supersample: .*less than or equal to 5"),
        ("supersample = 3", "supersamples = 3", "did you mean 'supersample'"),
        ("near_mm = 500 ", "near_mm = 4500 ", "near_mm 4500 must be less than range_gate.far"),
        ("far_mm = 4500", "far_mm = 100", "near_mm 500 must be less than range_gate.far_mm 100"),
        ("[[rig.emitter]]", "[nothing]", "no such setting 'nothing'"),
        ('use = "tof_bilateral"', 'use = "tof_bilatral"', "did you mean 'tof_bilateral'"),
        (
            'use = "tof_multipath"',
            'use = "tof_bilateral"\nname = "more"',
            "reads the layer 'phasor_a'",
        ),
    ],
)  # fmt: skip
def test_what_cannot_work_is_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        load_sensor(changed(tmp_path, old, new))
    assert "\n" not in str(caught.value)


def test_light_needs_an_emitter(tmp_path: Path) -> None:
    own = (SENSOR_FOLDER / "kinect-v2.toml").read_text()
    start = own.index("[[rig.emitter]]")
    text = changed(tmp_path, own[start : own.index("[[stage]]")], "")
    with pytest.raises(ConfigError, match=r"measures the emitter's light .* the rig has no"):
        load_sensor(text)


def test_ranges_of_distributions_are_compared_at_their_worst() -> None:
    ranges = {
        "near_mm": Distribution(uniform=(500, 1500)),
        "far_mm": Distribution(uniform=(1200, 4000)),
    }
    with pytest.raises(ConfigError, match=r"near_mm 1500 must be less than .*far_mm 1200"):
        load_sensor("kinect-v2", {"range_gate": ranges})
