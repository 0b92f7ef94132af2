"""Settings from presets, files, assignments and arguments: values, precedence, error messages."""

from pathlib import Path
from typing import Any

import pytest

from glsim.core.errors import ConfigError
from glsim.settings.presets import preset_names, preset_title
from glsim.settings.schema import load_settings, parse_assignment

FILE = """
sensor = "kinect-v1"
seed = 7
split = [0.5, 0.25, 0.25]
devices = 2
[source]
kind = "folder"
root = "/faces"
unit = "cm"
[pose]
yaw_deg = { uniform = [-30, 30] }
distance_mm = 800
[stage.axial]
base_sigma_mm = 2.0
[output]
crop = 128
layers = ["clean", "reason"]
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.toml"
    path.write_text(FILE)
    return path


def test_a_file_is_read_whole(file: Path) -> None:
    settings = load_settings(file)
    assert (settings.sensor, settings.seed, settings.devices) == ("kinect-v1", 7, 2)
    assert settings.split == (0.5, 0.25, 0.25)
    source: Any = settings.source[0]
    assert (source.kind, source.root, source.unit) == ("folder", Path("/faces"), "cm")
    assert (source.subjects, source.frames_per_subject) == (None, None)  # a folder has an end
    assert settings.pose.yaw_deg.uniform == (-30, 30)
    assert settings.pose.distance_mm.constant == 800
    assert settings.stage["axial"]["base_sigma_mm"].constant == 2.0
    assert (settings.output.crop, settings.output.layers) == (128, ("clean", "reason"))


def test_assignments_go_over_the_file_and_callers_over_both(file: Path) -> None:
    settings = load_settings(
        file,
        ["seed=8", "output.crop = 64", "axial.base_sigma_mm=3", "axial.angle_mm=0.5", "devices=3"],
        {"seed": 9, "stage": {"axial": {"base_sigma_mm": 4.0}}},
        {"subjects": 5},
    )
    assert (settings.seed, settings.output.crop, settings.devices) == (9, 64, 3)
    assert settings.output.layers == ("clean", "reason")
    axial = {name: value.constant for name, value in settings.stage["axial"].items()}
    assert axial == {"base_sigma_mm": 4.0, "angle_mm": 0.5}
    assert (settings.source[0].kind, settings.source[0].subjects) == ("folder", 5)


def test_several_sources(tmp_path: Path) -> None:
    path = tmp_path / "two.toml"
    path.write_text('[[source]]\nsubjects = 3\n[[source]]\nkind = "folder"\nroot = "x"\n')
    one, other = load_settings(path).source
    assert (one.kind, one.subjects, one.frames_per_subject) == ("procedural", 3, 30)
    assert (other.kind, other.subjects) == ("folder", None)
    with pytest.raises(ConfigError, match=r"has several \[\[source\]\] tables: set them there"):
        load_settings(path, source={"subjects": 1})
    with pytest.raises(ConfigError, match=r"--set source.subjects=1: source is not a single table"):
        load_settings(path, ["source.subjects=1"])


@pytest.mark.parametrize(
    ("text", "path", "value"),
    [
        ("seed=7", ["seed"], 7),
        ("sensor=kinect-v1", ["sensor"], "kinect-v1"),
        ('sensor="a=b.toml"', ["sensor"], "a=b.toml"),
        ("strict=true", ["strict"], True),
        ("pose.yaw_deg = {uniform=[-20, 20]}", ["pose", "yaw_deg"], {"uniform": [-20, 20]}),
        ("axial.base_sigma_mm=2.5", ["stage", "axial", "base_sigma_mm"], 2.5),
        ("stage.axial.base_sigma_mm=2", ["stage", "axial", "base_sigma_mm"], 2),
        ("split=[1, 0, 0]", ["split"], [1, 0, 0]),
        ("split=0.7,0.2,0.1", ["split"], "0.7,0.2,0.1"),
        ("source.root=/a b/c", ["source", "root"], "/a b/c"),
    ],
)
def test_assignments_are_toml_or_bare_words(text: str, path: list[str], value: object) -> None:
    assert parse_assignment(text) == (path, value)


@pytest.mark.parametrize("text", ["seed", "seed=", "=7", "axial..x=1", ".seed=1", "  =  "])
def test_an_assignment_without_name_or_value_is_refused(text: str) -> None:
    with pytest.raises(ConfigError, match=r"write name=value, e.g. axial.base_sigma_mm=2.5"):
        load_settings(None, [text])


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("sede=1", r"--set sede=1: no such setting 'sede' \(did you mean 'seed' or 'scene'\?\)"),
        ("pose.yaw=1", r"no such setting 'pose.yaw' \(did you mean 'pose.yaw_deg'\?\)"),
        ("output.crops=1", r"no such setting 'output.crops' \(did you mean 'output.crop'\?\)"),
        ("source.subject=1", r"did you mean 'source.subjects'\?"),
        ("zzz=1", "no such setting 'zzz' .known: appearance, devices, motion, output, pose"),
        ("seed=-1", "seed: .*greater than or equal to 0 .got -1"),
        ("seed=9223372036854775808", "seed: .*less than"),
        ("seed=1.5", "seed: .*integer.*got 1.5"),
        ("split=0.5,0.5", r"split: give 3 shares \(train, val, test\) .got '0.5,0.5'"),
        ("split=[0.5, 0.5, 0.5]", r"split \[0.5, 0.5, 0.5\]: the shares must be >= 0 and add up"),
        ("split=[inf, 0, 0]", "the shares must be >= 0 and add up to 1"),
        ("split=a,b,c", "split.0: .*number.*got 'a'"),
        ("source=[]", "source: at least one is needed"),
        ("scene.wall_albedo=1.5", "scene.wall_albedo: .*less than or equal to 1"),
        ("output.format=gif", "output.format: 'gif' is not one of png, webdataset"),
        ("output.crop=7", "output.crop: .*greater than or equal to 8"),
        ("output.depth_unit_mm=0", "output.depth_unit_mm: .*greater than or equal to 0.01"),
        ("output.layers=[]", "output: layers must be one or more of clean, noisy, infrared, infra"),
        ('output.layers=["clean", "clean"]', "output: layers must be one or more of .*, once"),
        ('output.layers=["depth"]', "output.layers.0: 'depth' is not one of clean, noisy, infrare"),
        ("pose.yaw_deg=far", "pose.yaw_deg: .*got 'far'"),
        ("pose=5", "pose: .*got 5"),
    ],
)
def test_a_bad_setting_is_named_with_the_near_ones(assignment: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_settings(None, [assignment])


def test_a_bad_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"none\.toml: no such file"):
        load_settings(tmp_path / "none.toml")
    bad = tmp_path / "bad.toml"
    for text, message in (
        (b"seed = = 1", ".*line 1"),
        (b"\xff", ".*no UTF-8 text"),
        (b"[pose]\nyaw = 1", "no such setting 'pose.yaw'"),
        (
            b"[stripe]\nheight_mm = 5",
            "no such setting 'stripe' .* those of stages in the table stage",
        ),
    ):
        bad.write_bytes(text)
        with pytest.raises(ConfigError, match=rf"bad\.toml: {message}"):
            load_settings(bad)
    with pytest.raises(ConfigError, match=r"is a folder: give a \.toml file"):
        load_settings(tmp_path)


def test_the_shipped_presets_load_and_have_a_title() -> None:
    names = "heads living-room office overcast paper randomised sample still-views sun window"
    assert preset_names() == names.split()
    for name in preset_names():
        load_settings(preset=name)
        assert 20 < len(preset_title(name)) < 90
    other = load_settings(None, ["pose.yaw_deg={uniform=[0, 5]}"], preset="office").pose.yaw_deg
    assert (other.uniform, other.normal, other.per) == ((0, 5), None, "sequence")
    office = load_settings(preset="office")
    assert office.source[0].kind == "people"
    assert office.scene.room == "office"
    assert load_settings(preset="living-room").scene.room == "living-room"


def test_a_file_then_assignments_then_options_change_a_preset(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("[scene]\nclutter = 0.1\ncamera_mm = 900\n[output]\ncrop = 64\n")
    settings = load_settings(
        file, ["scene.camera_mm=1100"], {"output": {"crop": 32}}, {"subjects": 7}, "office"
    )
    assert settings.scene.clutter.constant == 0.1
    assert settings.scene.camera_mm.constant == 1100
    assert settings.output.crop == 32
    assert (settings.source[0].kind, settings.source[0].subjects) == ("people", 7)
    assert settings.source[0].model_dump()["framing"] == "bust"


def test_another_source_or_a_wall_takes_the_place_of_the_presets() -> None:
    heads = load_settings(None, [], {}, {"kind": "procedural"}, "office")
    assert not hasattr(heads.source[0], "framing")
    assert heads.scene.room == "office"
    wall = load_settings(None, ["scene.wall_mm=4000"], {}, None, "office")
    assert wall.scene.room == "none"


def test_counts_hold_for_sources_of_every_kind(tmp_path: Path) -> None:
    """As a settings file's do; other keys of [source] mean nothing to another kind."""
    faces = {"kind": "ict-facekit", "root": str(tmp_path)}
    drawn = load_settings(None, [], {}, faces, "randomised").source[0]
    assert (drawn.kind, drawn.subjects, drawn.frames_per_subject) == ("ict-facekit", 20000, 90)
    fewer = load_settings(None, ["source.subjects=3"], {}, faces, "randomised")
    assert fewer.source[0].subjects == 3
    several = [{"kind": "procedural"}, {"kind": "people", "framing": "bust"}]
    both = load_settings(None, [], {"source": several}, None, "randomised")
    assert [source.subjects for source in both.source] == [10, 10]
