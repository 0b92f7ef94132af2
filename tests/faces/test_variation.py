"""Varied heads: a smooth, reproducible change of the requested size."""

import numpy as np
import pytest
from moderngl import Context

from glsim.core.mesh import SKIN_ALBEDO, Mesh
from glsim.faces.face_source import Face, FaceKey
from glsim.faces.variation import vary
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import Settings, VariationSettings, load_settings
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import simulate
from glsim.simulation.plan.tasks import make_tasks
from tests.support.scenes import TwoSequences, face_mesh, settings_for

KEYS = ScopeSeeds(frame=1, sequence=2, subject=3)


def variation(**values: object) -> VariationSettings:
    return load_settings(overrides={"variation": values}).variation


def cloud(count: int = 4000) -> Face:
    """Return a face of random points in a head's bounding box."""
    points = np.random.default_rng(0).uniform(-120, 120, (count, 3)).astype(np.float32)
    return Face(FaceKey("a", "s", 0), Mesh(points, np.array([[0, 1, 2]], np.int32)))


def warps(settings: VariationSettings, people: int = 60) -> np.ndarray:
    """Return the warps (people, V, 3) in millimetres."""
    face = cloud()
    varied = [vary(face, settings, KEYS._replace(subject=n)) for n in range(people)]
    return np.stack([v.mesh.vertices_mm - face.mesh.vertices_mm for v in varied])


def test_the_warp_is_as_large_as_said() -> None:
    warp_mm = warps(variation(shape_mm=3))
    assert warp_mm.std(axis=(0, 1)) == pytest.approx(3.0, rel=0.1)  # 60 heads of few waves each
    assert abs(warp_mm.mean()) < 0.3


def test_reflectivity_spreads_as_said_and_stays_possible() -> None:
    face = cloud()
    settings = variation(albedo=0.3)
    albedo = [vary(face, settings, KEYS._replace(subject=n)).mesh.albedo for n in range(60)]
    inside = np.concatenate(albedo)
    assert np.log(inside / SKIN_ALBEDO).std() == pytest.approx(0.28, rel=0.1)  # cut at 0.95
    wild = vary(face, variation(albedo=2), KEYS).mesh.albedo
    assert wild.min() >= 0.02
    assert wild.max() <= 0.95
    assert wild.dtype == np.float32


def test_neighbours_stay_neighbours_and_nothing_folds() -> None:
    """Across a millimetre the warp differs by its slope: never as much as the millimetre."""
    points = cloud().mesh.vertices_mm
    settings = variation(shape_mm=6)
    for axis in range(3):
        step = np.zeros(3, np.float32)
        step[axis] = 1.0
        pairs = np.concatenate([points, points + step])
        face = Face(FaceKey("a", "s", 0), Mesh(pairs, np.array([[0, 1, 2]], np.int32)))
        for person in range(20):
            varied = vary(face, settings, KEYS._replace(subject=person)).mesh.vertices_mm
            first, second = np.split(varied, 2)
            assert ((second - first)[:, axis] > 0).all()


def test_per_says_when_it_changes() -> None:
    face = cloud(100)
    for scope in ("frame", "sequence", "subject"):
        settings = variation(shape_mm=3, per=scope)
        base = vary(face, settings, KEYS).mesh.vertices_mm
        for other in ("frame", "sequence", "subject"):
            changed = vary(face, settings, KEYS._replace(**{other: 9})).mesh.vertices_mm
            assert np.array_equal(base, changed) == (other != scope)


def test_frames_are_varied_and_say_so(context: Context) -> None:
    overrides = {"variation": {"shape_mm": {"uniform": [2, 6]}, "albedo": 0.4, "per": "frame"}}
    sources = [TwoSequences(face_mesh(60))]

    def made(settings: Settings) -> list[Frame]:
        tasks = make_tasks(settings, list(sources))[:2]
        made = simulate(settings, tasks, sources=sources, context=context)
        return [frame for frame in made if isinstance(frame, Frame)]

    plain = made(settings_for("kinect-v2-fast"))
    varied, again = (made(settings_for("kinect-v2-fast", **overrides)) for _ in range(2))
    for one, two, same in zip(plain, varied, again, strict=True):
        assert not np.array_equal(one.image("clean"), two.image("clean"))
        assert np.array_equal(two.image("noisy"), same.image("noisy"))
        assert 2 <= two.parameters["variation.shape_mm"] <= 6
        assert two.parameters["variation.albedo"] == 0.4
        assert "variation.albedo" not in one.parameters
    assert varied[0].parameters != varied[1].parameters
