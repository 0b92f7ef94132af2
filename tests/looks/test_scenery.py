"""Scenery in frames: kept arrays, any order, walls behind the face, other people, light."""

from typing import Any

import cv2
import numpy as np
import pytest
from moderngl import Context

from glsim.core.camera import Emitter, SensorRig
from glsim.core.errors import ConfigError
from glsim.faces.face_source import Face, FaceKey, FaceSource
from glsim.looks.room.room import RoomNumbers, build_room
from glsim.looks.room.scenery import body_of, build_scenery
from glsim.looks.room.view import camera_place, room_view, visible_mesh
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import load_settings
from glsim.simulation.frame import Frame, Skipped
from glsim.simulation.no_effect import no_effect
from glsim.simulation.pipeline import open_sources, simulate
from glsim.simulation.plan.tasks import make_tasks
from tests.support.figures import FACE_MM, Figures, figure
from tests.support.scenes import V2, face_mesh, frames_of, layers_of, settings_for

OFFICE = {"room": "office", "clutter": 1.0, "camera_mm": 1000}


def scenery_of(seeds: ScopeSeeds, pose: dict[str, Any] | None = None, **scene: Any) -> Any:
    settings = load_settings(overrides={"scene": OFFICE | scene, "pose": pose or {}})
    return build_scenery(settings.scene, settings.pose, seeds, SensorRig(V2))


def figures(context: Context, sensor: str = "ideal", **tables: Any) -> list[Any]:
    source = {"kind": "procedural", "subjects": 2, "frames_per_subject": 4}
    settings = load_settings(
        overrides={"sensor": sensor, "source": source, "strict": True} | tables
    )
    layers = ("clean", "noisy", "regions", "infrared")
    sources: list[FaceSource] = [Figures()]
    tasks = make_tasks(settings, sources)
    return list(simulate(settings, tasks, sources=sources, context=context, layers=layers))


def test_a_room_is_kept_for_its_subject_and_another_one_has_another() -> None:
    first = scenery_of(ScopeSeeds(1, 2, 3))
    again = scenery_of(ScopeSeeds(8, 9, 3))
    other = scenery_of(ScopeSeeds(1, 2, 4))
    assert all(a.mesh is b.mesh for a, b in zip(first.props, again.props, strict=True))
    assert first.sampled == again.sampled
    assert other.sampled["scene.behind_mm"] != first.sampled["scene.behind_mm"]
    per_frame = [scenery_of(ScopeSeeds(n, 2, 3), per="frame") for n in (1, 2)]
    assert per_frame[0].sampled != per_frame[1].sampled


def test_drawn_numbers_are_in_their_ranges_and_faces_are_numbers_of_one_topology() -> None:
    scenery = scenery_of(ScopeSeeds(1, 2, 3), behind_mm={"uniform": [1500, 1600]}, clutter=0.4)
    assert 1500 <= scenery.sampled["scene.behind_mm"] <= 1600
    assert scenery.sampled["scene.clutter"] == 0.4
    assert scenery.sampled["scene.camera_mm"] == pytest.approx(1000, abs=0.1)
    assert scenery.sampled["scene.tilt_deg"] > 5
    assert sum(len(p.mesh.faces) for p in scenery.props) < 30_000
    for prop in scenery.props:
        assert prop.mesh.albedo.min() >= 0
        assert prop.mesh.albedo.max() <= 1
        a, b, c = prop.mesh.faces.T
        assert ((a != b) & (b != c) & (c != a)).all()


@pytest.mark.parametrize("room", ["office", "living-room"])
def test_furniture_hides_no_pixel_of_the_person(context: Context, room: str) -> None:
    """Not while the person's place is drawn per frame and the room stays, either."""
    pose = {"distance_mm": {"uniform": [700, 2500]}, "x_mm": {"uniform": [-200, 200]}}
    for seed in range(2):
        scenes = ({"room": kind, "clutter": 1.0, "camera_mm": 1000} for kind in ("empty", room))
        alone, inside = (figures(context, seed=seed, pose=pose, scene=scene) for scene in scenes)
        for a, b in zip(alone, inside, strict=True):
            face = [f.regions == f.region_numbers["face"] for f in (a, b)]
            assert face[0].sum() > 3000
            np.testing.assert_array_equal(*face)
            assert b.clean_m[b.clean_m > 0].min() > 0.25


def test_frames_of_rooms_are_the_same_in_any_order(context: Context) -> None:
    tables = {"scene": OFFICE | {"people": 2}, "output": {"crop": 96}}
    source = {"kind": "procedural", "subjects": 3, "frames_per_subject": 2}
    settings = load_settings(overrides={"sensor": "ideal", "source": source} | tables)
    sources: list[FaceSource] = [Figures()]
    tasks = make_tasks(settings, sources)
    found: dict[Any, Any] = {}
    for order in (tasks, tasks[::-1]):
        frames = simulate(settings, order, sources=[Figures()], context=context)
        for task, frame in zip(order, frames, strict=True):
            if task.index in found:
                np.testing.assert_array_equal(frame.clean, found[task.index])
            found[task.index] = frame.clean
    assert len(found) == 6
    assert not np.array_equal(found[0], found[4])


def test_a_body_stands_on_the_floor(context: Context) -> None:
    """Below the feet the floor is as far as the feet, and the camera is at its height."""
    scene = {"room": "empty", "camera_mm": 1300}
    for frame in figures(context, pose={"distance_mm": 3500}, scene=scene):
        assert frame.parameters["scene.eye_mm"] == FACE_MM
        assert frame.parameters["scene.camera_mm"] == pytest.approx(1300, abs=1)
        codes, numbers = frame.regions, frame.region_numbers
        column = codes[:, 254]
        feet = np.flatnonzero(column == numbers["face"]).max()
        assert column[feet + 1] == numbers["floor"]
        assert abs(int(frame.clean[feet, 254]) - int(frame.clean[feet + 1, 254])) < 30


def test_other_people_are_strangers_who_stand_behind(context: Context) -> None:
    scene = OFFICE | {"room": "empty", "people": 3, "behind_mm": 4000, "width_mm": 8000}
    found = figures(context, pose={"distance_mm": 1500}, scene=scene)
    shown = [f.parameters["scene.people"] for f in found]
    assert max(shown) >= 2
    for frame in found:
        person = frame.regions == frame.region_numbers["person"]
        face = frame.regions == frame.region_numbers["face"]
        if person.any():
            assert frame.clean[person].min() > frame.clean[face].max()
    assert any((f.regions == f.region_numbers["person"]).any() for f in found)
    source = Figures()
    settings = load_settings(
        overrides={"sensor": "ideal", "scene": scene,
                   "source": {"kind": "procedural", "subjects": 2, "frames_per_subject": 4}}
    )  # fmt: skip
    list(simulate(settings, sources=[source], context=context))
    strangers = {key.subject for key in source.loaded} - {"f000", "f001"}
    assert strangers
    assert min(strangers) >= "f002"


def test_settings_without_effect_are_told_but_those_of_presets_are_not() -> None:
    given = ["scene.people=2", "motion.x_mm_s=9", "motion.z_mm_s=9", "scene.room=office", "seed=3"]
    settings = load_settings(None, [*given, "source.kind=procedural"], preset="office")
    assert no_effect(settings, open_sources(settings)) == [
        "motion.x_mm_s, motion.z_mm_s have no effect: they need motion.within_exposure=true",
        "scene.people puts nobody behind: it needs a source of whole people (--source people)",
    ]


def test_heads_without_a_body_have_no_other_people(context: Context) -> None:
    settings = settings_for(scene=OFFICE | {"people": 2}, source={"kind": "procedural"})
    (frame,) = frames_of(context, settings, face_mesh(40))
    assert frame.parameters["scene.people"] == 0


def test_a_wall_in_front_of_the_face_is_refused_or_recorded(context: Context) -> None:
    with pytest.raises(ConfigError, match=r"scene.wall_mm: the wall, at 800 mm at most, always"):
        settings_for(scene={"wall_mm": 800})
    drawn = {"wall_mm": {"uniform": [700, 1400]}}
    settings = settings_for(scene=drawn, source={"kind": "folder", "frames_per_subject": 12})
    found = list(simulate(settings, sources=[_Static()], context=context))
    skipped = [f for f in found if isinstance(f, Skipped)]
    made = [f for f in found if isinstance(f, Frame)]
    assert skipped
    assert made
    assert all("the wall at" in f.why and "the face" in f.why for f in skipped)
    assert all(f.parameters["scene.wall_mm"] > 900 for f in made)


class _Static(FaceSource):
    """Many frames of one face."""

    name = "static"

    def subjects(self, count: int | None) -> list[str]:
        return ["one"]

    def frames(self, subject: str, count: int | None) -> list[FaceKey]:
        return [FaceKey(subject, "main", n) for n in range(count or 1)]

    def load(self, keys: Any) -> Any:
        for key in keys:
            yield Face(key, face_mesh(40))


def test_a_wall_and_a_room_and_bad_numbers_are_refused() -> None:
    with pytest.raises(ConfigError, match="give a wall or a room"):
        settings_for(scene={"wall_mm": 1500, "room": "office"})
    with pytest.raises(ConfigError, match=r"clutter may be 2, but must lie in \[0, 1\]"):
        settings_for(scene={"room": "office", "clutter": 2})
    with pytest.raises(ConfigError, match="not one of none, empty, office, living-room"):
        settings_for(scene={"room": "kitchen"})
    with pytest.raises(ConfigError, match="set it to bust or body"):
        load_settings(overrides={"source": {"kind": "people"}, "scene": {"room": "office"}})


def test_flat_walls_and_floors_are_all_lit(context: Context) -> None:
    """An empty room hides nothing from an emitter beside the camera, but for its recesses."""
    rig = SensorRig(V2, (Emitter((0.045, 0.0, 0.0), 0.005),))
    numbers = RoomNumbers("empty", 3, 2500.0, 4000.0, 2500.0, 12.0, 0.0, 0, None, (0.0, 1500.0),
                          (0.0, 0.0, 0.0))  # fmt: skip
    plain = [s for s in build_room(numbers)[0] if s.region in ("wall", "floor", "ceiling")]
    flat = [
        s for s in plain if len(s.faces) == 2 and abs(np.ptp(s.vertices_mm, axis=0).min()) < 1e9
    ]
    view = room_view(camera_place((0.0, 0.0, 1500.0), 1250.0, 5.0), 5.0)
    mesh = visible_mesh(flat, view, rig)
    found = layers_of(context, rig, [mesh])
    seen = found["clean"] > 0
    assert seen.mean() > 0.8
    assert found["clean"].max() > 3.5
    dark = seen & (found["lit"] < 1)
    assert dark.mean() < 0.002, "lines along the edges of recesses and corners"
    # A pixel whose 7 x 7 neighbours lie in its plane has no shadow: no speckle on any surface.
    position = V2.unproject(found["clean"])
    plane = np.concatenate(
        [found["normal"][..., :3], (found["normal"][..., :3] * position).sum(2)[..., None]], 2
    )
    size = np.ones((7, 7), np.uint8)
    spread = cv2.dilate(plane, size) - cv2.erode(plane, size)
    inside = seen & (spread.max(axis=2) < 0.005)
    assert inside.mean() > 0.7
    assert (found["lit"][inside] == 1).all()


def test_the_head_casts_its_shadow_on_a_wall_of_a_room(context: Context) -> None:
    """The shadow beside a head at 1 m on a wall at 3 m is f * b * (1 / 1 - 1 / 3) wide."""
    settings = settings_for(
        "kinect-v2", pose={"distance_mm": 1000}, seed=4,
        scene={"room": "empty", "behind_mm": 2000, "turn_deg": 0, "width_mm": 6000},
    )  # fmt: skip
    (frame,) = frames_of(context, settings, face_mesh(80))
    row = int(V2.cy)
    shadow = (frame.reason_codes[row] == 2).sum()  # Reason.SHADOW
    expected = V2.fx * 0.045 * (1 / 1.0 - 1 / 3.0)
    assert 0.25 * expected < shadow < 1.6 * expected  # light of the room gives the rest a depth


def test_a_body_is_found_by_its_size_or_by_its_notes() -> None:
    key = FaceKey("a", "b", 0)
    assert body_of(Face(key, face_mesh(40))) is None
    whole = body_of(Face(key, figure()))
    assert whole.floor_mm == pytest.approx(-FACE_MM, abs=4)
    assert whole.seat_mm is None
    noted = body_of(Face(key, face_mesh(40), notes={"floor_mm": -1200.0}))
    assert noted.floor_mm == -1200
