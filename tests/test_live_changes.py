"""Changing a simulator between frames: values, code of a stage and layers, as for a new one."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from moderngl import Context

from glsim.core.errors import ConfigError, ShaderError
from glsim.faces.one_mesh import OneMesh
from glsim.noise import stage_pass
from glsim.noise.stage_pass import StagePass
from glsim.render.renderer import Renderer
from glsim.settings.schema import Settings, load_settings, with_assignments
from glsim.settings.source_settings import parse_source
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import Simulator, simulate
from glsim.simulation.plan.tasks import Task, make_tasks
from tests.support.scenes import LOUD, face_mesh, only_frame, sensor_file

STAGES = 'use = "axial"\nbase_sigma_mm = 3', 'use = "range_gate"\nnear_mm = 300'


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    loaded = load_settings(overrides={"sensor": sensor_file(tmp_path, *STAGES, emitter=True)})
    single = parse_source({"subjects": 1, "frames_per_subject": 1})
    return loaded.model_copy(update={"source": (single,)})


@pytest.fixture
def sources() -> list[OneMesh]:
    return [OneMesh(face_mesh(40))]


def only(simulator: Simulator, tasks: Sequence[Task]) -> Frame:
    return only_frame(simulator.frames(tasks))


def fresh(settings: Settings, sources: Sequence[OneMesh], context: Context) -> Frame:
    return only_frame(simulate(settings, sources=sources, context=context))


def calls_of(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str) -> list[tuple[Any, ...]]:
    """Return a list that gets the arguments of each call of a function, which works on."""
    calls: list[tuple[Any, ...]] = []
    function = getattr(owner, name)

    def counted(*given: Any) -> Any:
        calls.append(given)
        return function(*given)

    monkeypatch.setattr(owner, name, counted)
    return calls


def assert_same(first: Frame, second: Frame) -> None:
    for layer in ("clean", "noisy", "infrared", "reason"):
        assert np.array_equal(first.image(layer), second.image(layer)), layer


@pytest.mark.parametrize(
    "values",
    [
        {"axial.base_sigma_mm": {"uniform": [5, 9]}, "axial.enabled": True},
        {"pose.distance_mm": 700, "pose.yaw_deg": 20, "seed": 4},
        {"rig.focal_px": [70, 70], "rig.emitter": [], "scene.wall_mm": 1500},
    ],
)
def test_other_values_give_the_frames_of_a_new_simulator(
    context: Context, settings: Settings, sources: list[OneMesh], values: Mapping[str, Any]
) -> None:
    simulator = Simulator(settings, sources, context)
    changed = simulator.with_values(values)
    wanted = fresh(with_assignments(settings, values), sources, context)
    assert_same(only(changed, make_tasks(changed.settings, sources)), wanted)
    before = only(simulator, make_tasks(settings, sources))
    assert not np.array_equal(before.noisy, wanted.noisy), "the values must matter"


def test_only_what_has_changed_is_loaded_rendered_linked_and_drawn(
    context: Context, settings: Settings, sources: list[OneMesh], monkeypatch: pytest.MonkeyPatch
) -> None:
    tasks = make_tasks(settings, sources)
    simulator = Simulator(settings, sources, context)
    rendered = calls_of(monkeypatch, Renderer, "render")
    linked = calls_of(monkeypatch, stage_pass, "link")
    drawn = calls_of(monkeypatch, StagePass, "draw")

    def stages_drawn(of: Simulator, of_tasks: Sequence[Task] = tasks) -> list[str]:
        drawn.clear()
        only(of, of_tasks)
        return [stage.name for stage, *_ in drawn]

    assert stages_drawn(simulator) == ["axial", "range_gate"]
    assert stages_drawn(simulator) == ["axial", "range_gate"], "from now on they are kept"
    assert stages_drawn(simulator) == []
    assert stages_drawn(simulator.with_values({"range_gate.near_mm": 400})) == ["range_gate"]
    assert linked == []
    louder = simulator.with_stage("axial", LOUD)
    assert [source.file.name for _, source in linked] == ["axial.glsl"]
    assert stages_drawn(louder) == ["axial", "range_gate"]
    assert len(rendered) == 1, "neither values nor code of a stage change what is rendered"
    turned = louder.with_values({"pose.yaw_deg": 30})
    other = [replace(tasks[0], seeds=tasks[0].seeds._replace(frame=1))]
    assert stages_drawn(turned) == stages_drawn(turned, other) == ["axial", "range_gate"]
    assert len(rendered) == 3
    assert_same(only(simulator, tasks), fresh(settings, sources, context))


def test_a_stage_from_a_file_equals_that_file_in_the_sensor(
    context: Context, settings: Settings, sources: list[OneMesh], tmp_path: Path
) -> None:
    file = tmp_path / "loud.glsl"
    file.write_text(LOUD)
    simulator = Simulator(settings, sources, context).with_values({"axial.angle_mm": 5})
    changed = simulator.with_stage("axial", file).with_values({"axial.amount_mm": 12})
    own = tmp_path / "own.toml"
    text = 'use = "loud.glsl"\nname = "axial"\namount_mm = 12'
    own.write_text(Path(settings.sensor).read_text().replace(STAGES[0], text))
    wanted = fresh(settings.model_copy(update={"sensor": str(own)}), sources, context)
    assert_same(only(changed, make_tasks(settings, sources)), wanted)
    moved = (wanted.noisy_m - wanted.clean_m)[(wanted.noisy_m > 0) & (wanted.clean_m > 0)]
    assert np.allclose(moved, 0.012, atol=1e-5)


def test_a_new_stage_goes_where_it_is_asked_for(
    context: Context, settings: Settings, sources: list[OneMesh]
) -> None:
    simulator = Simulator(settings, sources, context)
    names = [s.name for s in simulator.with_stage("loud", LOUD).sensor.stages]
    assert names == ["axial", "range_gate", "loud"]
    first = simulator.with_stage("loud", LOUD, before="axial")
    again = first.with_stage("loud", LOUD.replace("7.0", "8.0")).with_values({"seed": 2})
    assert [s.name for s in again.sensor.stages] == ["loud", "axial", "range_gate"]
    with pytest.raises(ConfigError, match=r"axail.*did you mean"):
        simulator.with_stage("loud", LOUD, before="axail")


def test_a_mistake_says_where_and_leaves_the_simulator(
    context: Context, settings: Settings, sources: list[OneMesh]
) -> None:
    tasks = make_tasks(settings, sources)
    simulator = Simulator(settings, sources, context)
    before = only(simulator, tasks)
    with pytest.raises(ShaderError, match=r"axial\.glsl:8: .*amount_m"):
        simulator.with_stage("axial", LOUD.replace("amount_mm);", "amount_m);"))
    with pytest.raises(ConfigError, match="dpeth"):
        simulator.with_stage("axial", LOUD.replace("u_depth", "u_dpeth"))
    for values, why in (({"axial.base_sigma_mm": -1}, "outside"), ({"source": {}}, "source")):
        with pytest.raises(ConfigError, match=why):
            simulator.with_values(values)
    assert_same(only(simulator, tasks), before)
