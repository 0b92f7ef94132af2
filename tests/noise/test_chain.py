"""Chains of stages: the user's own shaders, misfits that are refused, recorded draws, targets."""

from pathlib import Path

import numpy as np
import pytest
from moderngl import Context

from glsim.core.errors import ConfigError, ShaderError
from glsim.core.reason import Reason
from glsim.sensors.sensor import SENSOR_FOLDER, load_sensor
from glsim.settings.distribution import Distribution
from glsim.simulation.frame import Frame
from tests.support.scenes import frames_of, plate, sensor_file, settings_for

ADD = """#version 330 core
// add: moves everything.
uniform float by_mm = 5.0; //@ [-100, 100] mm how far
uniform int times = 1;     //@ [0, 10]     1  how often
uniform sampler2D u_depth;
out float depth;
void main() {
    float here = texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r;
    depth = here > 0.0 ? here + 0.001 * by_mm * float(times) : 0.0;
}
"""


def run(context: Context, sensor: str, frames: int = 1, **overrides: object) -> Frame:
    return frames_of(context, settings_for(sensor, **overrides), plate(), frames)[-1]


def values(frame: Frame) -> set[int]:
    return set(np.unique(frame.noisy[frame.clean > 0]).tolist())


@pytest.fixture
def add(tmp_path: Path) -> Path:
    (tmp_path / "add.glsl").write_text(ADD)
    return tmp_path


def test_a_users_shader_is_a_stage_by_its_path(context: Context, add: Path) -> None:
    frame = run(context, sensor_file(add, 'use = "add.glsl"'))
    assert values(frame) == {905}
    assert set(np.unique(frame.clean)) == {0, 900}
    absolute = sensor_file(add, f'use = "{add / "add.glsl"}"\nby_mm = -7\ntimes = 2')
    assert values(run(context, absolute)) == {886}


def test_stages_run_in_order_under_names_of_their_own(context: Context, add: Path) -> None:
    grid = 'use = "millimetre_quantise"\nstep_mm = 100'
    first = sensor_file(add, 'use = "add.glsl"\nby_mm = 60', grid)
    assert values(run(context, first)) == {1000}
    last = sensor_file(add, grid, 'use = "add.glsl"\nby_mm = 60')
    assert values(run(context, last)) == {960}
    two = 'use = "add.glsl"', 'use = "add.glsl"\nname = "again"\nby_mm = 10'
    both = sensor_file(add, *two)
    assert values(run(context, both)) == {915}
    assert values(run(context, both, stage={"again": {"by_mm": 20}})) == {925}
    assert values(run(context, both, stage={"add": {"enabled": False}})) == {910}
    with pytest.raises(ConfigError, match=r"two stages are called 'add': give each a name = "):
        load_sensor(sensor_file(add, two[0], two[0]))


def test_switched_off_stages_leave_no_trace(context: Context, add: Path) -> None:
    off = sensor_file(add, 'use = "add.glsl"\nenabled = false', 'use = "gaussian"\nenabled = 0')
    frame = run(context, off)
    np.testing.assert_array_equal(frame.noisy, frame.clean)
    assert not (frame.reason[frame.clean > 0] != Reason.VALID).any()


def test_a_layer_whose_stage_is_switched_off_is_named(context: Context, tmp_path: Path) -> None:
    sensor = sensor_file(tmp_path, 'use = "infrared"\nenabled = false', 'use = "low_signal"')
    with pytest.raises(ConfigError, match=r"'low_signal' reads the layer 'infrared', .* is switch"):
        run(context, sensor)


def stage_text(outputs: str, reads: str = "", body: str = "") -> str:
    return f"#version 330 core\n// odd\n{reads}\n{outputs}\nvoid main() {{ {body} }}\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (stage_text(""), "the stage writes no layer: declare e.g. 'out float depth;'"),
        (stage_text("out float a;\nout float b; //@ 1/2"), "all layers .* must have the same size"),
        (stage_text("out float a;", "uniform float enabled = 1.0; //@ [0, 1] 1 x"), "is taken"),
    ],
)
def test_a_stage_that_cannot_be_is_named(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "odd.glsl").write_text(text)
    with pytest.raises(ShaderError, match=message):
        load_sensor(sensor_file(tmp_path, 'use = "odd.glsl"'))


@pytest.mark.parametrize(
    ("stages", "message"),
    [
        (['use = "low_signal"'], "'low_signal' reads the layer 'infrared', which no stage before"),
        (['use = "odd.glsl"'], "glsim binds no uniform 'u_sede' .did you mean 'u_seed'"),
        (['use = "despeckle"', 'use = "shadow"'], "'shadow' is a shader and comes after 'despeck"),
        (['use = "axail"'], "no such stage 'axail' .did you mean 'axial'.*a path that ends in"),
        (["base_sigma_mm = 1"], 'stage 1: say which stage with use = "..."'),
        (['use = "disparity_quantise"'], "works on disparity, but the rig has no emitter"),
        (['use = "gaussian"\nsigma_px = 0.1'], "works on disparity, but the rig has no emitter"),
        (['use = "axial"\nbase_sigma = 1'], "no such parameter 'base_sigma' .*'base_sigma_mm'"),
        (['use = "axial"\nbase_sigma_mm = 101'], r"base_sigma_mm: 101 is outside \[0, 100\] mm"),
        (['use = "perlin"\noctaves = 1.5'], "perlin.octaves: 1.5 is not a whole number"),
        (['use = "perlin"\noctaves = { uniform = [1, 9] }'], r"octaves: 9 is outside \[1, 8\]"),
        (['use = "gaussian"\nsigma_mm = { normal = [2, 1] }'], r"sigma_mm: -1 is outside"),
        (['use = "gaussian"\nsigma_mm = "much"'], r"stage 1: gaussian.sigma_mm: .*got 'much'"),
    ],
)
def test_what_does_not_fit_is_refused_before_anything_is_drawn(
    tmp_path: Path, stages: list[str], message: str
) -> None:
    (tmp_path / "odd.glsl").write_text(stage_text("out float a;", "uniform uint u_sede;"))
    with pytest.raises(ConfigError, match=message):
        load_sensor(sensor_file(tmp_path, *stages))


def changed(folder: Path, old: str, new: str) -> str:
    """A copy of the file of kinect-v2 with ``old`` replaced by ``new``."""
    text = (SENSOR_FOLDER / "kinect-v2.toml").read_text(encoding="utf-8")
    assert old in text
    (folder / "sensor.toml").write_text(text.replace(old, new), encoding="utf-8")
    return str(folder / "sensor.toml")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("[80, 16, 120]", "[]", r"rig.modulation_mhz \[\]: give three frequencies above 1 MHz"),
        ("[80, 16, 120]", "[80, 32, 120]", "first must be a whole multiple of the second"),
        ("[80, 16, 120]", "[80, 20, 120]", "the phases repeat after 7.50 m, nearer than"),
        ("supersample = 3", "supersample = 2", "supersample 2 must be odd"),
        ("supersample = 3", "supersamples = 3", "did you mean 'rig.supersample'"),
        ("near_mm = 500 ", "near_mm = 4500 ", "near_mm 4500 must be less than range_gate.far"),
        ("[[rig.emitter]]", "[nothing]", "no such setting 'nothing'"),
        ('use = "tof_bilateral"', 'use = "tof_bilatral"', "did you mean 'tof_bilateral'"),
        ('use = "tof_multipath"', 'use = "tof_bilateral"\nname = "more"', "layer 'phasor_a'"),
    ],
)  # fmt: skip
def test_what_cannot_work_is_one_line(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        load_sensor(changed(tmp_path, old, new))


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
