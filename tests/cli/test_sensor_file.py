"""A saved sensor: the original file with other values, comments and order kept."""

import re
from pathlib import Path

import pytest

from glsim.cli.tune_page.sensor_file import other_values, save_sensor
from glsim.cli.tune_page.tuning import StageCode, Tuning
from glsim.core.errors import ConfigError
from glsim.sensors.sensor import SENSOR_FOLDER, load_sensor, sensor_names, sensor_of
from glsim.settings.schema import load_settings, with_assignments
from tests.support.scenes import LOUD


@pytest.mark.parametrize("name", sensor_names())
def test_an_unchanged_sensor_is_saved_byte_by_byte(name: str, tmp_path: Path) -> None:
    save_sensor(Tuning(name), load_sensor(name), tmp_path / "own.toml")
    assert (tmp_path / "own.toml").read_bytes() == (SENSOR_FOLDER / f"{name}.toml").read_bytes()


def test_changed_values_keep_the_comments_around_them(tmp_path: Path) -> None:
    values = {
        "axial.base_sigma_mm": 3.5,
        "axial.max_sigma_mm": {"uniform": [10, 20]},
        "lateral.enabled": False,
        "despeckle.min_area_px": 30,
        "rig.focal_px": [500.0, 500.0],
        "rig.emitter": [{"position_m": [0.09, 0, 0]}],
        "pose.yaw_deg": 20,
    }
    tuning = Tuning("kinect-v1", values)
    settings = with_assignments(load_settings(overrides={"sensor": "kinect-v1"}), values)
    sensor = sensor_of(settings)
    file = tmp_path / "own.toml"
    assert save_sensor(tuning, sensor, file) == [file]
    text, original = file.read_text(), (SENSOR_FOLDER / "kinect-v1.toml").read_text()
    for line in original.splitlines():
        if line.startswith("#"):
            assert line in text
    assert "sigma_px = 0.8     # Nguyen 2012" in text
    assert re.search(r"^min_area_px = 30 +# tuned, was 20$", text, re.MULTILINE)
    assert re.search(r"^base_sigma_mm = 3\.5 +# tuned, was 1\.\d+$", text, re.MULTILINE)
    assert ', tuned"\n' in text
    save_sensor(Tuning(str(file), {"despeckle.min_area_px": 25}), load_sensor(str(file)), file)
    assert "min_area_px = 25" in file.read_text()
    assert "# tuned, was 30" in file.read_text()
    assert file.read_text().count(', tuned"') == 1
    file.write_text(text)
    assert load_sensor(str(file)).stages == sensor.stages
    assert load_sensor(str(file)).rig == sensor.rig
    assert other_values(tuning) == {"pose.yaw_deg": 20}


def test_a_sensor_that_extends_another_keeps_what_it_extends(tmp_path: Path) -> None:
    values = {
        "rig.focal_px": [400.0, 400.0],
        "stereo_light.gain_counts": 70.0,
        "match_stereo.uniqueness_percent": 30,
        "spatial_filter.enabled": True,
    }
    name = "realsense-d435-high-accuracy"
    settings = with_assignments(load_settings(overrides={"sensor": name}), values)
    sensor, file = sensor_of(settings), tmp_path / "own.toml"
    save_sensor(Tuning(name, values), sensor, file)
    assert load_sensor(str(file)).stages == sensor.stages
    assert load_sensor(str(file)).rig == sensor.rig
    assert "extends" in file.read_text()
    with pytest.raises(ConfigError, match="no stage 'axial'"):
        save_sensor(Tuning(name, {"axial.base_sigma_mm": 1.0}), sensor, tmp_path / "other.toml")
    new = Tuning(name, {}, {"first": StageCode(LOUD, "stereo_light", new=True)})
    with pytest.raises(ConfigError, match=f"cannot be saved: {name} extends another"):
        save_sensor(new, sensor, tmp_path / "new.toml")


def test_changed_code_is_saved_beside_it(tmp_path: Path) -> None:
    original = tmp_path / "from"
    original.mkdir()
    (original / "loud.glsl").write_text(LOUD)
    own = original / "own.toml"
    own.write_text(
        'title = "own"\n[rig]\nwidth = 64\nheight = 64\nfocal_px = [60, 60]\n'
        'centre_px = [32, 32]\n[[stage]]\nuse = "axial" # noise\nangle_mm = 2\n'
        '[[stage]]\nuse = "loud.glsl"\namount_mm = 4\n'
    )
    changes = {
        "axial": StageCode(LOUD.replace("7.0", "8.0")),
        "first": StageCode(LOUD, "axial", new=True),
        "last": StageCode(LOUD, new=True),
    }
    tuning = Tuning(str(own), {"first.amount_mm": 2.0}, changes)
    from glsim.noise.registry import shader_stage
    from glsim.sensors.sensor import StageChange

    settings = load_settings(overrides={"sensor": str(own)})
    stage = with_assignments(settings, {"first.amount_mm": 2.0}).stage
    changed = [
        StageChange(name, shader_stage(Path(f"{name}.glsl"), code.text), code.before)
        for name, code in changes.items()
    ]
    sensor = sensor_of(settings.model_copy(update={"stage": stage}), changed)
    target = tmp_path / "to" / "saved.toml"
    target.parent.mkdir()
    written = save_sensor(tuning, sensor, target)
    codes = [f"saved_{name}.glsl" for name in ("axial", "first", "last")]
    assert [path.name for path in written] == ["saved.toml", *codes]
    saved = load_sensor(str(target))
    assert [s.name for s in saved.stages] == ["first", "axial", "loud", "last"]
    assert [dict(s.settings) for s in saved.stages] == [dict(s.settings) for s in sensor.stages]
    assert "angle_mm" not in target.read_text(), "the changed code does not declare it"
    assert saved.stages[1].spec.source.text == sensor.stages[1].spec.source.text  # type: ignore[union-attr]


def test_a_sensor_file_has_its_suffix(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"\.toml"):
        save_sensor(Tuning("ideal"), load_sensor("ideal"), tmp_path / "own.txt")
