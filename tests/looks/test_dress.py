"""Dressed faces: the same bytes in any order, glasses and hair where they belong, switches."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from moderngl import Context

from glsim.core.errors import ConfigError
from glsim.faces.face_source import Face, FaceKey
from glsim.faces.one_mesh import OneMesh
from glsim.faces.procedural.model import REGIONS, head_model
from glsim.faces.variation import vary
from glsim.looks import binding, cloth
from glsim.looks.dress import Dresser, worn_regions
from glsim.sensors.sensor import sensor_of
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.face_loader import FaceLoader
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import simulate
from glsim.simulation.plan.tasks import make_tasks
from glsim.simulation.scenes import FrameScenes
from tests.support.scenes import face_mesh
from tests.support.wardrobe import appearance, dresser, frames, heads, keys, part, placed


def settings_for(**overrides: object) -> Settings:
    tree = {
        "sensor": "ideal",
        "source": {"subjects": 2, "frames_per_subject": 3},
        "output": {"crop": 200},
        "pose": {"distance_mm": 700},
        **overrides,
    }
    return load_settings(overrides=tree)


def drawn(settings: Settings, context: Context, **options: Any) -> list[Frame]:
    made = simulate(settings, sources=[heads()], context=context, **options)
    return [frame for frame in made if isinstance(frame, Frame)]


def test_everything_is_worn_and_finite() -> None:
    face = dresser().dress(frames("p0000", 1)[0], keys(3))
    assert {p.region for p in face.parts} == {"hair", "beard", "brow", "glasses", "cloth"}
    for worn in face.parts:
        mesh = worn.mesh
        assert np.isfinite(mesh.vertices_mm).all()
        assert mesh.vertices_mm.dtype == np.float32
        assert mesh.faces.min() >= 0
        assert mesh.faces.max() < len(mesh.vertices_mm)
        assert 0 <= mesh.albedo.min() <= mesh.albedo.max() <= 1


def test_the_same_bytes_in_any_order() -> None:
    faces = frames("p0000", 6)
    there = dresser()
    forward = [placed(there.dress(face, keys(5))) for face in faces]
    back = dresser()
    backward = [placed(back.dress(face, keys(5))) for face in faces[::-1]][::-1]
    for one, other in zip(forward, backward, strict=True):
        for a, b in zip(one, other, strict=True):
            assert a.tobytes() == b.tobytes()


def test_parts_are_never_changed_in_place() -> None:
    """The renderer uploads an array once, so a later frame may not write into an earlier one."""
    faces = frames("p0000", 6)
    there = dresser()
    first = there.dress(faces[0], keys(5))
    copies = [p.copy() for p in placed(first)]
    bare = faces[0].mesh.albedo.copy()
    for face in faces[1:]:
        there.dress(face, keys(5))
    for kept, copy in zip(placed(first), copies, strict=True):
        assert np.array_equal(kept, copy)
    assert np.array_equal(faces[0].mesh.albedo, bare)


def test_a_subject_shares_its_triangles_and_what_does_not_move() -> None:
    faces = frames("p0000", 6)
    there = dresser()
    first, last = (there.dress(face, keys(5)) for face in (faces[0], faces[3]))
    for a, b in zip(first.parts, last.parts, strict=True):
        assert a.mesh.faces is b.mesh.faces
    assert part(first, "glasses").mesh is part(last, "glasses").mesh


def test_beards_follow_the_jaw() -> None:
    """The lowest part of a beard goes down with the chin, and stays as thick as it was."""
    neutral = frames("p0001", 1)[0]
    vertices, _ = heads().neutral("p0001")
    open_mouth = heads().person("p0001").frame({"AU26": 1.0})
    chin = head_model().in_regions("chin")
    drop = (vertices - open_mouth)[chin, 1].mean()
    assert drop > 5
    there = dresser()
    worn = []
    for shape in (vertices, open_mouth):
        face = replace(neutral, mesh=replace(neutral.mesh, vertices_mm=shape))
        worn.append(part(there.dress(face, keys(11)), "beard").mesh.vertices_mm)
    moved = worn[0] - worn[1]
    low = np.linalg.norm(worn[0][:, None] - vertices[chin][None], axis=2).min(axis=1) < 12
    assert low.sum() > 50
    assert moved[low, 1].mean() == pytest.approx(drop, rel=0.35)
    gaps = []
    for shape, beard in zip((vertices, open_mouth), worn, strict=True):
        near = np.linalg.norm(beard[low][:, None] - shape[chin][None], axis=2).min(axis=1)
        gaps.append(np.median(near))
    assert gaps[0] == pytest.approx(gaps[1], abs=1.0)


@pytest.mark.long
def test_glasses_stand_before_the_eyes_and_off_the_nose() -> None:
    names = np.array(REGIONS)[head_model().regions]
    for number in range(6):
        subject = f"p000{number}"
        vertices, _ = heads().neutral(subject)
        face = dresser().dress(frames(subject, 1)[0], keys(100 + number))
        glasses = part(face, "glasses").mesh.vertices_mm
        eyes = vertices[np.isin(names, ["sclera", "iris", "pupil"])]
        front = glasses[np.abs(glasses[:, 0]) < 48]  # without the temples
        assert front[:, 2].min() > eyes[:, 2].max() + 1
        assert abs(front[:, 1].mean() - eyes[:, 1].mean()) < 15
        nose = vertices[names == "nose"]
        for point in front[np.abs(front[:, 0]) < 22]:
            beside = np.hypot(*(nose[:, :2] - point[:2]).T)
            nearest = np.argmin(beside)
            # Half of a rim's depth, and 0.6 mm for the slope of the nose beside its vertices.
            assert beside[nearest] > 2 or point[2] > nose[nearest, 2] - 2.1


@pytest.mark.long
def test_the_face_stays_free_of_hair(context: Context) -> None:
    """Of eyes, nose, cheeks and lips, hair hides little in the front view (glasses are off)."""
    settings = settings_for(
        source={"subjects": 12, "frames_per_subject": 1},
        appearance={"wear": "always", "beard": 0, "glasses": 0, "hair": 1},
    )
    bare = settings.model_copy(update={"appearance": appearance(wear="never")})
    inner = ("nose", "lids", "lips", "cheek", "sclera", "iris", "pupil", "chin")
    shares = []
    for dressed, naked in zip(
        drawn(settings, context, layers=("clean", "regions")),
        drawn(bare, context, layers=("clean", "regions")),
        strict=True,
    ):
        regions = [np.zeros((200, 200), int) for _ in range(2)]
        for canvas, frame in zip(regions, (dressed, naked), strict=True):
            canvas[frame.window.slices] = frame.region_codes
        wanted = [naked.region_numbers[name] for name in inner]
        face = np.isin(regions[1], wanted)
        shares.append((regions[0][face] == dressed.region_numbers["hair"]).mean())
    assert max(shares) < 0.25
    assert np.mean(shares) < 0.05


def test_regions_name_what_is_worn(context: Context) -> None:
    shares = {"hair": 1, "beard": 1, "brows": 1, "glasses": 1, "cloth": 1}
    settings = settings_for(appearance={"wear": "always", **shares})
    frame = drawn(settings, context, layers=("clean", "regions"))[0]
    assert {"hair", "beard", "glasses", "cloth"} <= set(frame.seen_regions)
    assert " ".join(worn_regions(settings.appearance, [heads()])) == "hair beard brow glasses cloth"
    assert worn_regions(appearance(wear="always", beard=0), [heads()]).count("beard") == 0
    assert worn_regions(appearance(), [heads()]) == []


def test_heads_stay_bare_unless_asked(context: Context) -> None:
    plain = drawn(settings_for(), context)
    for wear in ("auto", "never"):
        same = drawn(settings_for(appearance={"wear": wear, "glasses": 1}), context)
        for a, b in zip(plain, same, strict=True):
            assert a.clean_m.tobytes() == b.clean_m.tobytes()
            assert a.noisy_m.tobytes() == b.noisy_m.tobytes()
            assert a.parameters == b.parameters
    dressed = drawn(settings_for(appearance={"wear": "always"}), context)
    assert any(
        a.clean_m.tobytes() != b.clean_m.tobytes() for a, b in zip(plain, dressed, strict=True)
    )


def test_gloss_brightens_what_faces_the_camera(context: Context) -> None:
    """Skin's oil by 0.028 / (4 0.3^2) / 0.87 = 0.09 of white paper, lips and eyes by up to 0.3."""
    wear = {"wear": "always", "glasses": 0}
    looks = (settings_for(sensor="kinect-v2", appearance=wear | {"gloss": g}) for g in (0, 1))
    shots = [drawn(settings, context)[0] for settings in looks]
    assert shots[0].clean_m.tobytes() == shots[1].clean_m.tobytes()
    before, after = (shot.infrared_counts[shots[0].clean_m > 0] for shot in shots)
    more = (after - before)[before > 1e4] / before[before > 1e4]
    assert 0.05 < np.percentile(more, 95) < 0.25
    assert np.percentile(more, 1) > -0.02


@pytest.mark.long
def test_fewer_triangles_of_cloth_and_skin_under_it_move_hardly_any_depth(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against all triangles: 0.05 mm, and 99.6 % in 2 mm; a rim behind the neck is 5 mm off."""
    output, source = {"crop": 128, "depth_unit_mm": 0.1}, {"subjects": 3, "frames_per_subject": 1}
    settings = settings_for(
        sensor="kinect-v2", source=source, output=output, pose={"distance_mm": 900},
        appearance={"wear": "always"},
    )  # fmt: skip
    fewer = np.stack([frame.clean for frame in drawn(settings, context)])
    monkeypatch.setattr(cloth, "_DRAWN_SHARE", 1.0)
    monkeypatch.setattr(binding, "_RIM_RINGS", 1000)
    every = np.stack([frame.clean for frame in drawn(settings, context)])
    assert ((fewer > 0) == (every > 0)).mean() > 0.999
    both = (fewer > 0) & (every > 0)
    off_mm = 0.1 * np.abs(np.subtract(fewer, every, dtype=np.float64))[both]
    assert 0 < off_mm.mean() < 0.05
    assert (off_mm < 2).mean() > 0.996


def test_the_manifest_says_what_is_worn(context: Context) -> None:
    frame = drawn(settings_for(appearance={"wear": "always", "hair": 1, "glasses": 1}), context)[0]
    assert {"appearance.hair", "appearance.glasses", "appearance.cloth"} <= set(frame.notes)
    for name in ("hair_length_mm", "hair_albedo", "rim_albedo", "cloth_albedo"):
        assert frame.parameters[f"appearance.{name}"] > 0


def test_what_is_worn_follows_a_varied_head() -> None:
    face = frames("p0000", 1)[0]
    variation = load_settings(overrides={"variation": {"shape_mm": 5}}).variation
    varied = vary(face, variation, keys(5))
    there = dresser()
    hair = part(there.dress(face, keys(5)), "hair").mesh.vertices_mm
    moved = part(there.dress(varied, keys(5)), "hair").mesh.vertices_mm
    shift = np.linalg.norm(varied.mesh.vertices_mm - face.mesh.vertices_mm, axis=1)
    follow = np.linalg.norm(moved - hair, axis=1)
    assert np.median(follow) == pytest.approx(np.median(shift), rel=0.5)
    assert follow.max() < 4 * shift.max()


def test_a_source_without_regions_cannot_be_dressed() -> None:
    board = OneMesh(face_mesh())
    with pytest.raises(
        ConfigError, match=r"so nobody can be dressed: set appearance.wear = 'auto'"
    ):
        Dresser(board, appearance(wear="always"))
    face = Face(FaceKey("a", "s", 0), face_mesh())
    assert Dresser(board, appearance()).dress(face, keys(1)) is face


def test_a_far_head_is_drawn_with_the_triangles_that_cast_its_shadows() -> None:
    drawn_faces = []
    for distance_mm in (900, 2000):
        settings = settings_for(sensor="kinect-v2", pose={"distance_mm": distance_mm})
        task = make_tasks(settings, [heads()])[0]
        face = next(iter(heads().load([task.key])))
        assert isinstance(face, Face)
        loader = FaceLoader(settings, [heads()], sensor_of(settings).rig)
        drawn_faces.append(FrameScenes(loader, regions=False).build(task, face).meshes[0][0].faces)
    assert drawn_faces[0] is face.mesh.faces
    assert drawn_faces[1] is face.mesh.occluder
