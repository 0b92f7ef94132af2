"""Test that a wrong setting is named, with its place and the nearest right one."""

from pathlib import Path

import pytest

from glsim.cli import main
from glsim.core.errors import ConfigError
from glsim.settings.toml_tables import read_toml

SENSOR = """title = "tiny"
[rig]
width = 48
height = 40
{rig}
centre_px = [24, 20]
{rest}
"""
RIG = "focal_px = [60, 60]"
AXIAL = '[[stage]]\nuse = "axial"\n'
FILES = {
    "focal.toml": SENSOR.format(rig="focal = [60, 60]", rest=""),
    "missing.toml": SENSOR.format(rig="", rest=""),
    "emitter.toml": SENSOR.format(rig=RIG, rest="[[rig.emitter]]\nposition = [0.1, 0, 0]"),
    "lens.toml": SENSOR.format(rig=RIG, rest="[rig.distortion]\nk7 = 0.1"),
    "lens_nan.toml": SENSOR.format(rig=RIG, rest="[rig.distortion]\nk1 = nan"),
    "lens_limit.toml": SENSOR.format(rig=RIG, rest="[rig.distortion]\nlimit_tan = 11"),
    "apart.toml": SENSOR.format(rig=RIG, rest="[[rig.imager]]\nposition_m = [50, 0, 0]"),
    "kind.toml": SENSOR.format(rig=RIG, rest=AXIAL + "base_sigma_mm = { unifrom = [1, 2] }"),
    "stage.toml": SENSOR.format(rig=RIG, rest='[[stage]]\nuse = "axail"'),
    "config.toml": "[outptu]\ncrop = 64\n",
    "mixture.toml": "[[source]]\n[[source]]\nsubject = 3\n",
}
FANKHAUSER = ["--sensor", "kinect-v2-fankhauser"]


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--sensor", "focal.toml"], ["focal.toml: ", "'rig.focal'", "'rig.focal_px'"]),
        (["--sensor", "lens.toml"], ["no such setting 'rig.distortion.k7'", "k1", "limit_tan"]),
        (["--sensor", "lens_nan.toml"], ["rig.distortion.k1: must be a finite number"]),
        (["--sensor", "lens_limit.toml"], ["rig.distortion: limit_tan 11", "[0, 10]"]),
        (["--sensor", "missing.toml"], ["missing.toml: rig.focal_px: is missing"]),
        (["--sensor", "emitter.toml"], ["emitter.toml: ", "mean 'rig.emitter.0.position_m"]),
        (["--sensor", "kind.toml"], ["kind.toml: stage 1: axial.base_sigma_mm: ", "'uniform'"]),
        (["--sensor", "stage.toml"], ["stage.toml: stage 1: ", "'axail'", "'axial'"]),
        (["--config", "config.toml"], ["config.toml: ", "'outptu'", "'output'"]),
        (["--set", "pose.yaw_deg=abc"], ["--set pose.yaw_deg=abc: pose.yaw_deg: give a number"]),
        (["--set", "pose.yaw_deg={uniform=[1]}"], ["--set pose", "pose.yaw_deg.uniform.1: is m"]),
        (["--set", "rig.focal=[3,3]"], ["error: --set ", "'rig.focal'", "'rig.focal_px'"]),
        (["--set", "rig.deliver=rwa"], ["--set rig.deliver=rwa: rig.deliver: 'rwa'", "'raw'"]),
        ([*FANKHAUSER, "--set", "axial.base_sigma_mm=-3"], ["base_sigma_mm=-3: axial", "[0,"]),
        (
            [*FANKHAUSER, "--set", "axial.angle_mm=0.2", "--set", "axial.base_sigma=3"],
            ["error: --set axial.base_sigma=3: ", "'base_sigma_mm'"],
        ),
        ([*FANKHAUSER, "--set", "axail.base_sigma_mm=3"], ["error: --set ", "'axail'", "'axial"]),
        (["--set", "yaw_deg=2"], ["mean 'pose.yaw_deg'"]),
        (["--set", "sigma_mm=2"], ["mean 'tof_floor.sigma_mm'"]),
        (["--set", "tof_edge.sigma_mm=2"], ["'tof_edge' (did you mean 'tof_floor.sigma_mm'"]),
        (["--set", "noise.sigma_mm=2"], ["no stage 'noise' (did you mean 'tof_floor.sigma_mm'"]),
        (["--set", "rig.width=2"], ["error: --set rig.width=2: rig.width"]),
        (["--set", "pose.distance_mm=0.9"], ["may be 0.9, but", "mm: metres meant? 900"]),
        (["--set", "pose.distance_mm={normal=[0.9,0.1]}"], ["metres meant? 900"]),
        (["--set", "scene.wall_mm=1.5"], ["scene: wall_mm may be 1.5", "metres meant? 1500"]),
        (["--set", "output.nearest_to_mm=0.7"], ["(got 0.7): metres meant? 700"]),
        (["--set", "rig.far_m=8000"], ["(got 8000): millimetres meant? 8"]),
        (["--sensor", "apart.toml"], ["imager.0.position_m.0", "millimetres meant? 0.05"]),
        (["--set", "pose.yaw_deg=400"], ["yaw_deg may be 400, but must lie in [-360, 360]"]),
        (["--source", "proceduarl"], ["source.kind: 'proceduarl'", "'procedural'"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) and value[0][0] == "-" else "",
)
def test_a_wrong_setting_is_named_with_its_place(
    words: list[str], parts: list[str], here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, text in FILES.items():
        (here / name).write_text(text)
    assert main(["generate", "--plan", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    at = 0
    for part in parts:
        assert part in line[at:], line
        at = line.index(part, at)
    assert "Input should" not in line
    assert "kinect-v2.toml" not in line, "the sensor's file is not to blame"


@pytest.mark.parametrize("path", [r"C:\Users\me", r"C:\new\tables", r"..\user\scans", r"C:/a\d"])
def test_a_path_with_backslashes_is_asked_for_in_single_quotes(tmp_path: Path, path: str) -> None:
    file = tmp_path / "a.toml"
    file.write_text(f'# "C:\\\\a"\nroot = "{path}"\n')
    with pytest.raises(ConfigError, match=r"line 2: a backslash .* in single quotes"):
        read_toml(file)
    file.write_text(f"root = '{path}'\nname = \"a\\tb\"\n")
    assert read_toml(file) == {"root": path, "name": "a\tb"}
