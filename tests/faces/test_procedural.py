"""Procedural heads have measures within the human range for every seed, and perform."""

from collections import Counter

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.errors import ConfigError
from glsim.core.mesh import vertex_normals
from glsim.faces.procedural.model import REGIONS, head_model
from glsim.faces.procedural.parameters import FACTORS, PARAMETERS, sample_identity
from glsim.faces.procedural.subject import (
    HeadSubject,
    asymmetry_field,
    make_subject,
    neutral_head,
    subject_of,
)
from glsim.faces.regions import landmark_vertices
from glsim.faces.sources.procedural import ProceduralFaces
from tests.support.face_sets import assert_keys_decide
from tests.support.landmark_order import MIDLINE, MIRROR, assert_order

MODEL = head_model()
BY_NAME = {p.name: p for p in PARAMETERS}
MEAN = {p.name: p.mean for p in PARAMETERS}
X, Y, Z = MODEL.template_mm.T
HIDDEN = MODEL.in_regions("ear", "sclera", "iris", "pupil", "mouth", "teeth")
EYEBALL = MODEL.in_regions("sclera", "iris", "pupil")
FLIP = np.array([-1.0, 1.0, 1.0])
UPPER_FACE = {"AU1", "AU2", "AU4", "AU5", "AU43", "AU45"}
LOWER_FACE = {"AU14", "AU15", "AU16", "AU17", "AU18", "AU20", "AU22", "AU23", "AU24", "AU25",
              "AU26", "AU27", "AU28"}  # fmt: skip


@pytest.fixture(scope="module")
def source() -> ProceduralFaces:
    return ProceduralFaces(seed=5)


@pytest.fixture(scope="module")
def mean() -> HeadSubject:
    neutral = neutral_head(MEAN)  # without a person's asymmetry
    return subject_of(neutral, np.full(len(neutral), 0.6, np.float32))


@pytest.fixture(scope="module")
def people() -> list[HeadSubject]:
    return [make_subject(sample_identity(2, f"p{n:04d}"), 2, f"p{n:04d}") for n in range(16)]


def widest(points: NDArray[np.floating], low_y: float, high_y: float, back_z: float) -> float:
    """Return the greatest width (mm) of the skin between two heights of the template."""
    chosen = ~HIDDEN & (back_z < Z) & (low_y < Y) & (high_y > Y)
    return float(np.ptp(points[chosen, 0]))


def measure(points: NDArray[np.floating]) -> dict[str, float]:
    """Return the anthropometric measures (mm) of a neutral head (V, 3)."""
    at = points[MODEL.landmarks]
    glabella = (np.abs(X) < 0.1) & (Y > 30) & (Y < 42) & (Z > 0)
    pupils = [points[EYEBALL & (side * X > 0), 0].mean() for side in (1, -1)]
    return {
        "face_breadth": widest(points, -25, 10, -90.0),
        "head_breadth": widest(points, 45, 90, -90.0),
        "jaw_breadth": widest(points, -66, -56, -72.0),
        "head_length": float(points[glabella, 2].mean() - points[Y > 0, 2].min()),
        "face_height": float(at[27, 1] - at[8, 1]),
        "nose_protrusion": float(np.linalg.norm(at[30] - at[33])),
        "interocular": float(at[42, 0] - at[39, 0]),
        "eye_fissure_height": float((at[[43, 44], 1] - at[[47, 46], 1]).max()),
        "mouth_width": float(at[54, 0] - at[48, 0]),
        "pupils": float(pupils[0] - pupils[1]),
    }


def cross(points: NDArray[np.floating], triangles: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return (F, 3) normals of triangles, twice as long as their areas."""
    a, b, c = (points[triangles[:, k]].astype(np.float64) for k in range(3))
    return np.cross(b - a, c - a)


def mirror_pairs() -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Vertices of the face's skin and their mirror images on the template."""
    face = np.flatnonzero(~HIDDEN & ~MODEL.in_regions("lips", "lids") & (Z > -60) & (Y > -95))
    points = MODEL.template_mm[face[Y[face] < 60]]
    face = face[Y[face] < 60]
    here, there = (np.lexsort(np.round(p + 0.0, 3).T) for p in (points, points * FLIP))
    return face[here], face[there]


def test_subjects_and_frames_need_a_number(source: ProceduralFaces) -> None:
    assert source.subjects(2) == ["p0000", "p0001"]
    with pytest.raises(ConfigError, match=r"set source\.subjects"):
        source.subjects(None)
    with pytest.raises(ConfigError, match=r"set source\.frames_per_subject"):
        source.frames("p0000", None)


def test_frames_are_spread_over_sequences_from_neutral_to_neutral(source: ProceduralFaces) -> None:
    keys = source.frames("p0003", 70)
    assert len({(k.sequence, k.frame) for k in keys}) == 70
    assert list(Counter(k.sequence for k in keys).values()) == [30, 30, 10]
    assert source.frames("p0003", 60) == keys[:60]
    faces = list(source.load(keys[:30]))
    moved = [np.abs(f.mesh.vertices_mm - faces[0].mesh.vertices_mm).max() for f in faces]
    assert faces[0].expression == faces[-1].expression == {}
    assert moved[0] == moved[-1] == 0.0
    assert 5 < int(np.argmax(moved)) < 25
    assert max(moved) > 1.0


def test_bytes_do_not_depend_on_batch_order_or_instance(source: ProceduralFaces) -> None:
    assert_keys_decide(source, [*source.frames("p0001", 12), *source.frames("p0002", 4)])


def test_unknown_names_are_refused(source: ProceduralFaces, mean: HeadSubject) -> None:
    key = source.frames("p0000", 1)[0]
    with pytest.raises(ConfigError, match="no subject 'joe' of procedural"):
        list(source.load([type(key)("joe", key.sequence, 0)]))
    with pytest.raises(ConfigError, match="not a sequence name"):
        list(source.load([type(key)("p0000", "smile", 0)]))
    with pytest.raises(ConfigError, match="no action unit"):
        mean.frame({"AU99": 1.0})


def test_meshes_are_what_the_renderer_wants(source: ProceduralFaces) -> None:
    (face,) = source.load(source.frames("p0000", 1))
    mesh = face.mesh
    assert mesh.vertices_mm.dtype == mesh.albedo.dtype == np.float32
    assert mesh.faces.dtype == mesh.occluder.dtype == np.int32
    assert not mesh.faces.flags.writeable
    assert 14_000 <= len(mesh.vertices_mm) <= 26_000
    assert np.isfinite(mesh.vertices_mm).all()
    assert {REGIONS[n] for n in np.unique(MODEL.regions)} == set(REGIONS)
    assert 0.45 <= mesh.albedo[MODEL.in_regions("cheek")].mean() <= 0.75
    assert mesh.albedo[MODEL.in_regions("pupil")].max() < 0.15


def test_surface_is_manifold_and_symmetric() -> None:
    """Every directed edge once; open only at the end of the bust and at hidden rims."""
    faces = MODEL.triangles
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]).astype(np.int64)
    code = edges[:, 0] * 1_000_000 + edges[:, 1]
    assert len(np.unique(code)) == len(code)
    open_edges = edges[~np.isin(edges[:, 1] * 1_000_000 + edges[:, 0], code)]
    assert Y[open_edges[~HIDDEN[open_edges[:, 0]]]].max() < -450
    points = MODEL.template_mm
    a, b = (p[np.lexsort(np.round(p, 4).T[[0, 2, 1]])] for p in (points + 0.0, points * FLIP + 0.0))
    assert np.abs(a - b).max() < 1e-3


@pytest.mark.parametrize("number", range(5))
def test_people_face_outwards_with_short_edges_and_no_folds(
    people: list[HeadSubject], number: int
) -> None:
    points, faces = people[number].neutral, MODEL.triangles
    normals = cross(points, faces)
    front = points[faces].mean(axis=1)[:, 2] > np.quantile(points[:, 2], 0.7)
    total = normals[front].sum(axis=0)
    assert total[2] / np.linalg.norm(total) > 0.5
    frontal = (Z > -50) & (np.abs(X) < 70) & (Y < 85) & (Y > -95)
    chosen = faces[frontal[faces].all(axis=1)]
    edges = points[chosen] - points[np.roll(chosen, 1, axis=1)]
    assert np.linalg.norm(edges, axis=-1).mean() <= 4.2
    smooth = ~HIDDEN & ~MODEL.in_regions("lips", "lids", "nose")
    skin = smooth[faces].all(axis=1)
    turned = np.sum(cross(MODEL.template_mm, faces[skin]) * normals[skin], axis=1)
    assert (turned < 0).mean() < 0.002


def test_parameters_stay_in_their_ranges_and_go_together() -> None:
    drawn = [sample_identity(0, f"p{n:04d}") for n in range(400)]
    values = {p.name: np.array([identity[p.name] for identity in drawn]) for p in PARAMETERS}
    for p in PARAMETERS:
        assert p.low <= values[p.name].min() <= values[p.name].max() <= p.high
        assert 0.5 * p.sd < values[p.name].std() < 1.4 * p.sd
        assert len(p.loads) == len(FACTORS)
        assert sum(load**2 for load in p.loads) < 1.0, p.name
        assert 0.1 < np.abs(MODEL.identity.shape(p.name)[1]).max() < 3.0

    def correlation(a: str, b: str) -> float:
        return float(np.corrcoef(values[a], values[b])[0, 1])

    assert correlation("shoulder_breadth", "neck_breadth") > 0.3  # men
    assert correlation("facial_fat", "double_chin") > 0.4
    assert correlation("nasolabial_fold", "jowl") > 0.3  # age
    assert abs(correlation("chin_cleft", "ear_protrusion")) < 0.2


def test_mean_head_has_the_mean_measures() -> None:
    """Within about one sd of the norms that the table cites."""
    measured = measure(neutral_head({p.name: p.template for p in PARAMETERS}))
    assert measured.pop("pupils") == pytest.approx(64.0, abs=4.0)
    for name, value in measured.items():
        assert value == pytest.approx(BY_NAME[name].mean, abs=1.3 * BY_NAME[name].sd), name


@pytest.mark.parametrize(
    "name",
    ["face_breadth", "head_breadth", "jaw_breadth", "head_length", "face_height",
     "nose_protrusion", "interocular", "eye_fissure_height", "mouth_width"],
)  # fmt: skip
def test_measures_follow_their_parameters(name: str) -> None:
    p, base = BY_NAME[name], MEAN
    low, high = (measure(neutral_head({**base, name: p.mean + s * p.sd}))[name] for s in (-2, 2))
    assert (high - low) / (4 * p.sd) == pytest.approx(1.0, abs=0.3)


def test_no_two_people_are_alike(people: list[HeadSubject]) -> None:
    """Root mean square distance of two faces, pose aside, and the widths of shoulders."""
    front = (Z > -50) & (Y > -95) & (Y < 70)
    faces = [p.neutral[front] - p.neutral[front].mean(axis=0) for p in people]
    apart = [
        np.sqrt(np.mean(np.sum((a - b) ** 2, axis=1)))
        for i, a in enumerate(faces)
        for b in faces[:i]
    ]
    assert min(apart) > 2.3
    assert 4.0 < np.median(apart) < 9.0
    # bideltoid breadth: ANSUR II, 1st percentile of women 390, 99th of men 580 mm
    widths = [np.ptp(p.neutral[MODEL.in_regions("shoulder"), 0]) for p in people]
    assert 390 < min(widths) < max(widths) < 600


def test_asymmetry_has_the_size_of_real_faces(people: list[HeadSubject]) -> None:
    """0.63 mm rms along normals on average over 350 adults, sd 0.16 (see ``FIELD_MM``)."""
    face, other = mirror_pairs()
    rms = []
    for person in people:
        here, there = person.neutral[face], person.neutral[other] * FLIP
        here, there = here - here.mean(axis=0), there - there.mean(axis=0)
        u, _, vt = np.linalg.svd(there.T @ here)
        difference = there @ u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt - here
        normals = vertex_normals(person.neutral, MODEL.triangles)[face]
        rms.append(float(np.sqrt(np.mean(np.sum(difference * normals, axis=1) ** 2))))
    assert 0.45 < np.mean(rms) < 0.95
    assert 0.2 < min(rms) < max(rms) < 1.8


def test_asymmetry_is_smooth_antisymmetric_and_a_function_of_the_subject() -> None:
    one, same, other = (asymmetry_field(4, name) for name in ("a", "a", "b"))
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 0.3
    face, twin = mirror_pairs()
    np.testing.assert_allclose(one[face], -one[twin] * FLIP, atol=2e-3)
    points, faces = MODEL.template_mm, MODEL.triangles
    step = np.linalg.norm(one[faces[:, 0]] - one[faces[:, 1]], axis=1)
    apart = np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1)
    assert (step < 0.25 * apart + 0.3).all(), "no folds, also where rigid eyes and ears begin"


@pytest.mark.parametrize("unit", MODEL.units)
def test_units_act_where_they_should_on_both_sides(unit: str, mean: HeadSubject) -> None:
    rest, acted, left = (mean.frame(e) for e in ({}, {unit: 1.0}, {f"{unit}_L": 1.0}))
    moved = np.linalg.norm(acted - rest, axis=1)
    assert 1.5 <= moved.max() <= 46.0
    assert moved[Z < -120].max() < 0.5  # never the back of the head
    if unit in UPPER_FACE:
        assert moved[Y < -30].max() < 0.5
    if unit in LOWER_FACE:
        assert moved[Y > 25].max() < 0.5
    if unit not in ("AU26", "AU27", "AU28"):
        assert np.abs(left - rest)[X < -14].max() < 0.05
    assert np.linalg.norm(cross(acted, MODEL.triangles), axis=1).min() > 2e-5
    face, other = mirror_pairs()
    np.testing.assert_allclose(acted[face], acted[other] * FLIP, atol=2e-3)


def test_jaw_drop_opens_the_mouth_on_teeth(people: list[HeadSubject]) -> None:
    teeth = MODEL.in_regions("teeth")
    upper = teeth & (MODEL.jaw == 0)
    top, bottom = MODEL.landmarks[[62, 66]]
    for person in people[:4]:
        rest, drop, wide = (person.frame(e) for e in ({}, {"AU26": 1.0}, {"AU27": 1.0}))
        gap = [float(f[top, 1] - f[bottom, 1]) for f in (rest, drop, wide)]
        assert abs(gap[0]) < 0.5
        assert 10 < gap[1] < 25 < gap[2] < 50
        assert rest[upper, 2].max() < rest[MODEL.in_regions("lips"), 2].max() - 3, "behind lips"
        assert wide[upper, 1].min() - wide[teeth & ~upper, 1].max() > 12, "rows part"


@pytest.mark.parametrize("subject", ["p0000", "p0001", "p0002", "p0003"])
def test_lids_close_over_the_globe(subject: str) -> None:
    person = make_subject(sample_identity(0, subject), 0, subject)
    rest, shut = person.frame({}), person.frame({"AU43": 1.0})
    upper, lower = (strip[:, 0] for strip in MODEL.lids.strips)
    middle = rest[upper, 1] - rest[lower, 1] > 2.0
    assert middle.mean() > 0.6
    assert (shut[upper, 1] - shut[lower, 1]).max() < 0.1
    assert np.array_equal(rest[EYEBALL], shut[EYEBALL])


def test_landmarks_are_68_vertices_of_the_skin_mirrored_on_their_regions(
    source: ProceduralFaces,
) -> None:
    vertices = landmark_vertices(source)
    assert len(set(vertices.tolist())) == 68
    assert not HIDDEN[vertices].any()
    assert np.isin(vertices, MODEL.triangles).all()
    points = MODEL.template_mm[vertices]
    np.testing.assert_allclose(points[MIRROR] * FLIP, points, atol=1e-6)
    assert np.flatnonzero(np.arange(68) == MIRROR).tolist() == MIDLINE
    for part, names in (
        (slice(17, 27), ["brow"]),
        (slice(28, 31), ["nose"]),
        (slice(36, 48), ["lids", "skin"]),
        (slice(60, 68), ["lips"]),
    ):
        assert MODEL.in_regions(*names)[vertices[part]].all()
    for subject in ("p0000", "p0007"):
        assert_order(source.neutral(subject)[0][vertices].astype(np.float64))
