"""Changing a simulator between frames: values, code of a stage and layers, as for a new one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest

from glsim.errors import ConfigError, ShaderError
from glsim.faces.base import Face, FaceKey
from glsim.faces.one_mesh import OneMesh
from glsim.frame import Frame
from glsim.noise import stage_pass
from glsim.noise.stage_pass import StagePass
from glsim.pipeline import Simulator, simulate
from glsim.plan.tasks import Task, make_tasks
from glsim.render.renderer import Renderer
from glsim.settings.schema import Settings, load_settings, with_assignments
from glsim.settings.source_settings import parse_source
from tests.support.scenes import face_mesh

SENSOR = """
title = "small"
[rig]
width = 96
height = 80
focal_px = [80, 80]
centre_px = [48, 40]
[[rig.emitter]]
position_m = [0.05, 0, 0]
[[stage]]
use = "axial"
base_sigma_mm = 3
[[stage]]
use = "range_gate"
near_mm = 300
"""

#: The shipped stage of that name made louder: one more uniform, one less.
LOUD = """#version 330 core
// loud: adds the same amount everywhere.
#include "lib/depth.glsl"
uniform float amount_mm = 7.0; //@ [0, 100; 0, 20] mm how much
uniform sampler2D u_depth;
out float depth;
void main() {
    depth = moved_by_mm(texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r, amount_mm);
}
"""


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    file = tmp_path / "small.toml"
    file.write_text(SENSOR)
    loaded = load_settings(overrides={"sensor": str(file)})
    single = parse_source({"subjects": 1, "frames_per_subject": 1})
    return loaded.model_copy(update={"source": (single,)})


def planned(settings: Settings) -> tuple[list[OneMesh], Sequence[Task]]:
    sources = [OneMesh(face_mesh(40))]
    return sources, make_tasks(settings, list(sources))


def only(simulator: Simulator, tasks: Sequence[Task]) -> Frame:
    (frame,) = simulator.frames(tasks)
    assert isinstance(frame, Frame)
    return frame


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
        {"axial.base_sigma_mm": 9},
        {"axial.base_sigma_mm": {"uniform": [5, 9]}, "axial.enabled": True},
        {"axial.enabled": False},
        {"pose.distance_mm": 700, "pose.yaw_deg": 20, "seed": 4},
        {"rig.focal_px": [70, 70], "rig.emitter": [], "scene.wall_mm": 1500},
    ],
)
def test_other_values_give_the_frames_of_a_new_simulator(
    context: moderngl.Context, settings: Settings, values: Mapping[str, Any]
) -> None:
    sources, _ = planned(settings)
    simulator = Simulator(settings, sources, context)
    changed = simulator.with_values(values)
    tasks = make_tasks(changed.settings, list(sources))
    (wanted,) = simulate(with_assignments(settings, values), sources=sources, context=context)
    assert isinstance(wanted, Frame)
    assert_same(only(changed, tasks), wanted)
    before = only(simulator, make_tasks(settings, list(sources)))
    assert not np.array_equal(before.noisy, wanted.noisy), "the values must matter"


def test_other_noise_over_the_same_frame_renders_nothing_anew(
    context: moderngl.Context, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources, tasks = planned(settings)
    rendered = calls_of(monkeypatch, Renderer, "render")
    simulator = Simulator(settings, sources, context)
    quiet = only(simulator, tasks)
    loud = simulator.with_values({"axial.base_sigma_mm": 9})
    assert not np.array_equal(only(loud, tasks).noisy, quiet.noisy)
    more = simulator.with_stage("loud", LOUD).with_layers(("clean", "noisy"), ("normal",))
    assert not np.array_equal(only(more, tasks).noisy, quiet.noisy)
    assert len(rendered) == 1, "neither values nor code of a stage change what is rendered"

    turned = loud.with_values({"pose.yaw_deg": 30})
    assert not np.array_equal(only(turned, tasks).clean, quiet.clean)
    other = [replace(tasks[0], seeds=tasks[0].seeds._replace(frame=1))]
    only(turned, other)
    assert len(rendered) == 3, "a pose and another task do"
    (fresh,) = simulate(settings, tasks, sources=sources, context=context)
    assert isinstance(fresh, Frame)
    assert_same(only(simulator, tasks), fresh)


def test_a_source_that_shows_another_face_for_the_same_task_is_believed(
    context: moderngl.Context, settings: Settings
) -> None:
    near, far = face_mesh(40), replace(face_mesh(40), vertices_mm=face_mesh(40).vertices_mm * 0.8)

    class Changing(OneMesh):
        """Gives another mesh for the same task, as the source of ``glsim validate`` does."""

        shown = near

        def load(self, keys: Sequence[FaceKey]) -> Iterator[Face]:
            for face in super().load(keys):
                yield replace(face, mesh=self.shown)

    source = Changing(near)
    simulator = Simulator(settings, [source], context)
    tasks = make_tasks(settings, [source])
    clean = []
    for source.shown in (near, far, near):
        clean.append(only(simulator, tasks).clean)
    assert not np.array_equal(clean[0], clean[1])
    assert np.array_equal(clean[0], clean[2])


def test_stages_before_a_change_are_not_drawn_again(
    context: moderngl.Context, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources, tasks = planned(settings)
    drawn = calls_of(monkeypatch, StagePass, "draw")
    simulator = Simulator(settings, sources, context)

    def stages_drawn(of: Simulator, of_tasks: Sequence[Task]) -> list[str]:
        drawn.clear()
        only(of, of_tasks)
        return [stage.name for stage, *_ in drawn]

    assert stages_drawn(simulator, tasks) == ["axial", "range_gate"]
    assert stages_drawn(simulator, tasks) == ["axial", "range_gate"], "from now on they are kept"
    assert stages_drawn(simulator, tasks) == []
    assert stages_drawn(simulator.with_values({"range_gate.near_mm": 400}), tasks) == ["range_gate"]
    louder = simulator.with_stage("axial", LOUD)
    assert stages_drawn(louder, tasks) == ["axial", "range_gate"]
    assert stages_drawn(louder.with_values({"range_gate.enabled": False}), tasks) == []
    other = [replace(tasks[0], seeds=tasks[0].seeds._replace(frame=1))]
    assert stages_drawn(louder, other) == ["axial", "range_gate"]


def test_a_stage_that_was_off_is_drawn_from_what_is_there_now(
    context: moderngl.Context, settings: Settings
) -> None:
    """While it is off, its input is drawn into other targets, and again into the first ones."""
    sources, tasks = planned(settings)
    simulator = Simulator(settings, sources, context)
    frames = []
    for sigma_mm, gate in ((3, True), (3, True), (5, False), (7, False), (7, True)):
        values = {"axial.base_sigma_mm": sigma_mm, "range_gate.enabled": gate}
        frames.append(only(simulator.with_values(values), tasks))
    (fresh,) = simulate(with_assignments(settings, values), tasks, sources=sources, context=context)
    assert isinstance(fresh, Frame)
    assert_same(frames[-1], fresh)
    assert not np.array_equal(frames[0].noisy, fresh.noisy)


def test_any_changes_in_turn_give_the_frames_of_new_simulators(context: moderngl.Context) -> None:
    settings = load_settings(overrides={"sensor": "kinect-v2", "output": {"crop": 64}})
    single = parse_source({"subjects": 1, "frames_per_subject": 1})
    settings = settings.model_copy(update={"source": (single,)})
    sources, tasks = planned(settings)
    simulator = Simulator(settings, sources, context)
    stages = [stage.name for stage in simulator.sensor.stages]
    rng = np.random.default_rng(4)
    values: dict[str, Any] = {}
    refused = 0
    for _ in range(30):
        name = f"{rng.choice(stages)}.enabled"
        tried = values | {name: not values.get(name, True)}
        if rng.random() < 0.5:
            tried["tof_floor.sigma_mm"] = float(rng.integers(1, 9))
        try:
            frame = only(simulator.with_values(tried), tasks)
        except ConfigError:  # a stage reads a layer of one that is switched off
            refused += 1
            continue
        values = tried
        (fresh,) = simulate(
            with_assignments(settings, values), tasks, sources=sources, context=context
        )
        assert isinstance(fresh, Frame)
        assert_same(frame, fresh)
    assert 0 < refused < 15


def test_values_link_no_program_and_a_stage_links_one(
    context: moderngl.Context, settings: Settings, monkeypatch: pytest.MonkeyPatch
) -> None:
    sources, tasks = planned(settings)
    simulator = Simulator(settings, sources, context)
    linked = calls_of(monkeypatch, stage_pass, "link")
    changed = simulator.with_values({"axial.base_sigma_mm": 1, "pose.yaw_deg": 3})
    assert linked == []
    louder = changed.with_stage("axial", LOUD)
    assert [source.file.name for _, source in linked] == ["axial.glsl"]
    louder.with_layers(("clean", "noisy"), ("normal",))
    assert len(linked) == 1
    frame = only(louder, tasks)
    moved = (frame.noisy_m - frame.clean_m)[(frame.noisy_m > 0) & (frame.clean_m > 0)]
    assert np.allclose(moved, 0.007, atol=1e-5)


def test_a_stage_from_a_file_equals_that_file_in_the_sensor(
    context: moderngl.Context, settings: Settings, tmp_path: Path
) -> None:
    file = tmp_path / "loud.glsl"
    file.write_text(LOUD)
    sources, tasks = planned(settings)
    changed = Simulator(settings, sources, context).with_stage("axial", file)
    changed = changed.with_values({"axial.amount_mm": 12})
    own = tmp_path / "own.toml"
    own.write_text(
        SENSOR.replace(
            'use = "axial"\nbase_sigma_mm = 3',
            'use = "loud.glsl"\nname = "axial"\namount_mm = 12',
        )
    )
    other = settings.model_copy(update={"sensor": str(own)})
    (wanted,) = simulate(other, sources=sources, context=context)
    assert isinstance(wanted, Frame)
    assert_same(only(changed, tasks), wanted)


def test_a_new_stage_goes_where_it_is_asked_for(
    context: moderngl.Context, settings: Settings
) -> None:
    sources, _ = planned(settings)
    simulator = Simulator(settings, sources, context)
    names = [s.name for s in simulator.with_stage("loud", LOUD).sensor.stages]
    assert names == ["axial", "range_gate", "loud"]
    first = simulator.with_stage("loud", LOUD, before="axial")
    assert [s.name for s in first.sensor.stages] == ["loud", "axial", "range_gate"]
    again = first.with_stage("loud", LOUD.replace("7.0", "8.0")).with_values({"seed": 2})
    assert [s.name for s in again.sensor.stages] == ["loud", "axial", "range_gate"]
    with pytest.raises(ConfigError, match=r"axail.*did you mean"):
        simulator.with_stage("loud", LOUD, before="axail")


def test_a_mistake_names_its_line_and_leaves_the_simulator(
    context: moderngl.Context, settings: Settings
) -> None:
    sources, tasks = planned(settings)
    simulator = Simulator(settings, sources, context)
    before = only(simulator, tasks)
    broken = LOUD.replace("amount_mm);", "amount_m);")
    with pytest.raises(ShaderError, match=r"axial\.glsl:8: .*amount_m"):
        simulator.with_stage("axial", broken)
    with pytest.raises(ShaderError, match=r"axial\.glsl:4: .*range"):
        simulator.with_stage("axial", LOUD.replace("[0, 100; 0, 20] mm", "mm"))
    with pytest.raises(ConfigError, match="dpeth"):
        simulator.with_stage("axial", LOUD.replace("u_depth", "u_dpeth"))
    assert_same(only(simulator, tasks), before)


def test_values_of_a_parameter_that_has_gone_are_left_out(
    context: moderngl.Context, settings: Settings
) -> None:
    sources, _ = planned(settings)
    simulator = Simulator(settings, sources, context).with_values({"axial.angle_mm": 5})
    changed = simulator.with_stage("axial", LOUD)
    assert changed.settings.stage["axial"] == {}
    assert set(changed.sensor.stages[0].settings) == {"enabled", "amount_mm"}


def test_layers_are_asked_for_between_frames(context: moderngl.Context, settings: Settings) -> None:
    sources, tasks = planned(settings)
    simulator = Simulator(settings, sources, context)
    frame = only(simulator.with_layers(("clean", "noisy", "expected"), ("normal",)), tasks)
    assert frame.extra["normal"].shape[2] == 4
    assert (frame.expected > 0).any()
    assert only(simulator, tasks).expected_m is None


def test_refused_values_say_why(context: moderngl.Context, settings: Settings) -> None:
    sources, _ = planned(settings)
    simulator = Simulator(settings, sources, context)
    with pytest.raises(ConfigError, match=r"axial\.base_sigma_mm: -1 is outside"):
        simulator.with_values({"axial.base_sigma_mm": -1})
    with pytest.raises(ConfigError, match="no such parameter"):
        simulator.with_values({"axial.sigma": 1})
    with pytest.raises(ConfigError, match="source"):
        simulator.with_values({"source": {"kind": "ict-facekit"}})
