"""Procedural heads have measures within the human range for every seed."""

from __future__ import annotations

import pickle
from collections import Counter

import numpy as np
import pytest

from glsim.errors import ConfigError
from glsim.faces.base import Face
from glsim.faces.procedural import PARAMETERS, REGIONS, ProceduralFaces, sample_identity
from glsim.faces.procedural.grid import knot_row
from glsim.faces.procedural.parameters import BY_NAME, mean_identity
from glsim.faces.procedural.subject import HeadSubject, head_model, make_subject, neutral_head
from glsim.faces.procedural.template import PART_EYEBALL, PART_SKIN
from glsim.faces.procedural.topology import EYE_COLUMNS, MOUTH_COLUMN, SLIT_EYE, SLIT_MOUTH
from tests.support.head_points import slit_vertex, triangle_areas


@pytest.fixture(scope="module")
def source() -> ProceduralFaces:
    return ProceduralFaces(seed=5)


@pytest.fixture(scope="module")
def mean() -> HeadSubject:
    return make_subject(mean_identity(), 0, "mean")


def grid_vertex(row: int, column: int) -> int:
    """Return the (upper) skin vertex at a grid position."""
    head = head_model().template
    found = (head.row == row) & (head.column == column) & (head.part == PART_SKIN)
    return int(np.flatnonzero(found & ~(head.low & (head.slit > 0)))[0])


def widest(points: np.ndarray, low_y: float, high_y: float, back_z: float = -90.0) -> float:
    """Return the greatest width (mm) of the skin between two heights of the template."""
    head = head_model().template
    y = head.points[:, 1]
    face = (head.part == PART_SKIN) & (head.points[:, 2] > back_z)
    chosen = points[face & (y > low_y) & (y < high_y), 0]
    return float(chosen.max() - chosen.min())


def measure(points: np.ndarray) -> dict[str, float]:
    """Return the anthropometric measures (mm) of a neutral head (V, 3)."""
    head = head_model().template
    tip = int(np.argmax(np.where(head.column == 0, head.points[:, 2], -np.inf)))
    nasion, subnasale = grid_vertex(knot_row(4) + 1, 0), grid_vertex(knot_row(9), 0)
    left, right = (slit_vertex(SLIT_EYE, s * EYE_COLUMNS[0], False) for s in (1, -1))
    skull = head.points[:, 1] > 0
    middle = (EYE_COLUMNS[0] + EYE_COLUMNS[1]) // 2
    ball = head_model().template.part == PART_EYEBALL
    side = head_model().template.points[:, 0] > 0
    menton = points[
        (head_model().template.column == 0) & (head_model().template.row < 110), 1
    ].min()
    return {
        "face_breadth": widest(points, -25, 10),
        "head_breadth": widest(points, 45, 90),
        "jaw_breadth": widest(points, -66, -56, -72.0),
        "head_length": float(points[grid_vertex(knot_row(3), 0), 2] - points[skull, 2].min()),
        "face_height": float(points[nasion, 1] - menton),
        "nose_protrusion": float(np.linalg.norm(points[tip] - points[subnasale])),
        "interocular": float(points[left, 0] - points[right, 0]),
        "pupils": float(points[ball & side, 0].mean() - points[ball & ~side, 0].mean()),
        "eye_fissure_height": float(
            points[slit_vertex(SLIT_EYE, middle, False), 1]
            - points[slit_vertex(SLIT_EYE, middle, True), 1]
        ),
        "mouth_width": float(
            points[slit_vertex(SLIT_MOUTH, MOUTH_COLUMN, False), 0]
            - points[slit_vertex(SLIT_MOUTH, -MOUTH_COLUMN, False), 0]
        ),
    }


# --- the interface -------------------------------------------------------------------------------


def test_subjects_and_frames_need_a_number(source: ProceduralFaces) -> None:
    assert source.subjects(2) == ["p0000", "p0001"]
    with pytest.raises(ConfigError, match="give a number"):
        source.subjects(None)
    with pytest.raises(ConfigError, match="give a number"):
        source.frames("p0000", None)


def test_frames_are_spread_over_sequences(source: ProceduralFaces) -> None:
    keys = source.frames("p0000", 70)
    assert len(keys) == len({(k.sequence, k.frame) for k in keys}) == 70
    assert [n for _, n in Counter(k.sequence for k in keys).items()] == [30, 30, 10]
    assert source.frames("p0000", 60) == keys[:60]
    assert source.frames("p0000", 5)[-1].sequence == keys[0].sequence


def test_a_sequence_is_neutral_at_both_ends(source: ProceduralFaces) -> None:
    keys = source.frames("p0003", 30)
    faces = list(source.load(keys))
    moved = [np.abs(f.mesh.vertices_mm - faces[0].mesh.vertices_mm).max() for f in faces]
    assert faces[0].expression == {}
    assert faces[-1].expression == {}
    assert moved[0] == moved[-1] == 0.0
    assert 5 < int(np.argmax(moved)) < 25
    assert max(moved) > 1.0


def test_bytes_do_not_depend_on_batch_order_or_instance(source: ProceduralFaces) -> None:
    keys = [*source.frames("p0001", 12), *source.frames("p0002", 4)]
    forward = {f.key: f for f in source.load(keys)}
    other = pickle.loads(pickle.dumps(source))
    for key in reversed(keys):
        (face,) = other.load([key])
        assert isinstance(face, Face)
        assert face.mesh.vertices_mm.tobytes() == forward[key].mesh.vertices_mm.tobytes()
        assert face.mesh.albedo.tobytes() == forward[key].mesh.albedo.tobytes()
        assert face.mesh.faces is forward[key].mesh.faces
        assert face.expression == forward[key].expression


def test_unknown_names_are_refused(source: ProceduralFaces, mean: HeadSubject) -> None:
    key = source.frames("p0000", 1)[0]
    with pytest.raises(ConfigError, match="no procedural subject"):
        list(source.load([type(key)("joe", key.sequence, 0)]))
    with pytest.raises(ConfigError, match="not a sequence name"):
        list(source.load([type(key)("p0000", "smile", 0)]))
    with pytest.raises(ConfigError, match="no action unit"):
        mean.frames([{"AU99": 1.0}])


def test_meshes_are_what_the_renderer_wants(source: ProceduralFaces) -> None:
    for name in source.subjects(3):
        (face,) = source.load(source.frames(name, 1))
        mesh = face.mesh
        assert mesh.vertices_mm.dtype == np.float32
        assert mesh.faces.dtype == np.int32
        assert 15_000 <= len(mesh.vertices_mm) <= 26_000
        assert np.isfinite(mesh.vertices_mm).all()
        assert mesh.albedo.dtype == np.float32
        assert mesh.albedo.min() >= 0.02
        assert mesh.albedo.max() < 0.9
        assert mesh.faces.min() == 0
        assert mesh.faces.max() < len(mesh.vertices_mm)


def test_regions(source: ProceduralFaces) -> None:
    (face,) = source.load(source.frames("p0000", 1))
    assert source.regions.shape == face.mesh.albedo.shape
    present = {REGIONS[n] for n in np.unique(source.regions)}
    assert present == set(REGIONS)
    skin = face.mesh.albedo[source.regions == REGIONS.index("cheek")].mean()
    pupil = face.mesh.albedo[source.regions == REGIONS.index("pupil")].mean()
    assert 0.45 <= skin <= 0.75
    assert pupil < 0.15


# --- the shape -----------------------------------------------------------------------------------


def test_surface_is_manifold_and_faces_outwards() -> None:
    """Every directed edge once; open only at the shoulders and the pieces' hidden rims."""
    faces = head_model().template.faces
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    code = edges[:, 0] * 1_000_000 + edges[:, 1]
    assert len(np.unique(code)) == len(code)
    open_edges = edges[~np.isin(edges[:, 1] * 1_000_000 + edges[:, 0], code)]
    skin = head_model().template.part[open_edges[:, 0]] == PART_SKIN
    assert (head_model().template.row[open_edges[skin]] == head_model().template.row.max()).all()


def test_frontal_normals_point_out(source: ProceduralFaces) -> None:
    for name in source.subjects(4):
        (face,) = source.load(source.frames(name, 1))
        points, faces = face.mesh.vertices_mm.astype(np.float64), face.mesh.faces
        a, b, c = (points[faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        front = (a + b + c)[:, 2] / 3 > np.quantile(points[:, 2], 0.7)
        mean_normal = normals[front].sum(axis=0)
        assert mean_normal[2] / np.linalg.norm(mean_normal) > 0.5
        assert 390 < np.ptp(points[:, 0]) < 600  # bideltoid, ANSUR II: 1st to 99th percentile


def test_face_edges_are_short(source: ProceduralFaces) -> None:
    head = head_model().template
    for name in source.subjects(5):
        (face,) = source.load(source.frames(name, 1))
        points, faces = face.mesh.vertices_mm, face.mesh.faces
        x, y, z = head.points.T
        frontal = (z > -50) & (np.abs(x) < 70) & (y < 85) & (y > -95)
        chosen = faces[frontal[faces].all(axis=1)]
        edges = points[chosen] - points[np.roll(chosen, 1, axis=1)]
        assert np.linalg.norm(edges, axis=-1).mean() <= 3.5


def test_template_is_symmetric() -> None:
    points = head_model().template.points
    mirrored = points * np.array([-1.0, 1.0, 1.0])
    a, b = (p[np.lexsort(np.round(p, 4).T[[0, 2, 1]])] for p in (points + 0.0, mirrored + 0.0))
    assert np.abs(a - b).max() < 1e-3


# --- identity ------------------------------------------------------------------------------------


def test_parameters_stay_in_their_ranges() -> None:
    drawn = [sample_identity(0, f"p{n:04d}") for n in range(200)]
    assert len(PARAMETERS) >= 30
    for p in PARAMETERS:
        values = np.array([identity[p.name] for identity in drawn])
        assert values.min() >= p.low
        assert values.max() <= p.high
        assert 0.5 * p.sd < values.std() < 1.4 * p.sd
        assert p.source
        assert p.help


def test_every_parameter_has_a_field() -> None:
    size = np.abs(head_model().identity).reshape(len(PARAMETERS), -1).max(axis=1)
    assert np.isfinite(head_model().identity).all()
    for p, largest in zip(PARAMETERS, size, strict=True):
        assert 0.1 < largest < 3.0, p.name


def test_mean_head_has_the_mean_measures() -> None:
    """Within about one sd of the norms that the table cites."""
    measured = measure(neutral_head({p.name: p.template for p in PARAMETERS}))
    for name, value in measured.items():
        expected, slack = (64.0, 4.0) if name == "pupils" else (
            BY_NAME[name].mean, 1.3 * BY_NAME[name].sd
        )  # fmt: skip
        assert value == pytest.approx(expected, abs=slack), name


@pytest.mark.parametrize(
    "name",
    ["face_breadth", "head_breadth", "jaw_breadth", "head_length", "face_height",
     "nose_protrusion", "interocular", "eye_fissure_height", "mouth_width"],
)  # fmt: skip
def test_measures_follow_their_parameters(name: str) -> None:
    p, base = BY_NAME[name], mean_identity()
    low, high = (measure(neutral_head({**base, name: p.mean + s * p.sd}))[name] for s in (-2, 2))
    assert (high - low) / (4 * p.sd) == pytest.approx(1.0, abs=0.3)


def test_pupils_follow_the_inner_corners() -> None:
    base = mean_identity()
    near, far = (measure(neutral_head({**base, "interocular": v}))["pupils"] for v in (28.0, 38.0))
    assert far - near == pytest.approx(10.0, abs=2.0)


def test_subjects_differ() -> None:
    heads = [neutral_head(sample_identity(1, f"p{n:04d}")) for n in range(8)]
    front = (head_model().template.points[:, 2] > -50) & (head_model().template.points[:, 1] > -95)
    for i in range(8):
        for j in range(i):
            difference = (heads[i] - heads[j])[front]
            rms = np.sqrt(np.mean(np.sum(difference**2, axis=1)))
            assert 1.5 < rms < 20.0


@pytest.mark.long
def test_extremes_have_no_degenerate_triangles() -> None:
    for p in PARAMETERS:
        for value in (p.low, p.high):
            areas = triangle_areas(neutral_head({**mean_identity(), p.name: value}))
            assert areas.min() > 1e-4, p.name
