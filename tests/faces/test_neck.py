"""The neck: the head takes the pose, the shoulders stay, and the skin between them has no folds."""

import numpy as np
import pytest

from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.faces.neck import NECK_DEG, Neck, bend_neck, head_share, move_pose, trunk_angles
from glsim.faces.procedural.model import head_model
from glsim.faces.procedural.parameters import PARAMETERS
from glsim.faces.procedural.subject import neutral_head
from glsim.faces.sources.procedural import ProceduralFaces

Array = np.ndarray
NECK = Neck(head_share)
POSES = (
    {"yaw_deg": 30.0}, {"yaw_deg": -60.0}, {"pitch_deg": 25.0}, {"pitch_deg": -25.0},
    {"roll_deg": 30.0}, {"yaw_deg": 60.0, "pitch_deg": 25.0, "roll_deg": -45.0},
)  # fmt: skip


@pytest.fixture(scope="module")
def mean() -> Mesh:
    return Mesh(
        neutral_head({p.name: p.mean for p in PARAMETERS}).astype(np.float32),
        head_model().triangles,
    )


def seen(mesh: Mesh, pose: dict[str, float]) -> Array:
    """Vertices (V, 3) in camera mm, after the pose with its neck."""
    (bent,) = bend_neck([mesh], NECK, pose, pose)
    matrix = pose_matrix(pose | {"distance_mm": 900.0})
    return np.asarray(1000 * (bent.vertices_mm @ matrix[:3, :3].T + matrix[:3, 3]))


def test_the_head_takes_the_pose_exactly(mean: Mesh) -> None:
    head = head_share(mean.vertices_mm) == 1.0
    for pose in POSES:
        (bent,) = bend_neck([mean], NECK, pose, pose)
        np.testing.assert_array_equal(bent.vertices_mm[head], mean.vertices_mm[head])
    assert bend_neck([mean], NECK, {}, {})[0] is mean
    assert bend_neck([mean], None, POSES[0], POSES[0])[0] is mean


def test_an_open_mouth_belongs_to_the_head(mean: Mesh) -> None:
    source = ProceduralFaces(1)
    lower = head_model().in_regions("chin", "lips", "teeth", "mouth")
    wide = source.person("p0000").frame({"AU27": 1.0})
    assert head_share(wide[lower]).min() > 0.99


def test_shoulders_stay_upright_below_a_small_turn(mean: Mesh) -> None:
    shoulders = head_share(mean.vertices_mm) == 0.0
    assert shoulders.sum() > 2000
    rest = seen(mean, {})
    moved = np.abs(seen(mean, {"yaw_deg": 10.0}) - rest)[shoulders]
    # the trunk follows by 10 - 45 tanh(10 / 45) = 0.16 degrees
    assert trunk_angles({"yaw_deg": 10.0})["yaw_deg"] == pytest.approx(0.161, abs=0.01)
    # the face's centre is where the pose says, so the neck under it moves by 95 mm times the angle
    assert np.ptp(moved[:, 1]) < 0.1
    assert moved[:, 0].max() < 95 * np.deg2rad(10.0) + 2


def test_far_turns_take_the_shoulders_along() -> None:
    angles = [trunk_angles({"yaw_deg": yaw})["yaw_deg"] for yaw in (0.0, 30.0, 90.0, 180.0)]
    assert angles == sorted(angles)
    assert angles[0] == 0.0
    assert 180.0 - angles[3] == pytest.approx(NECK_DEG["yaw_deg"], abs=0.1)


@pytest.mark.parametrize("pose", POSES)
def test_the_neck_has_no_folds_and_keeps_its_thickness(mean: Mesh, pose: dict[str, float]) -> None:
    faces = mean.faces
    share = head_share(mean.vertices_mm)
    bending = ((share[faces] > 0) & (share[faces] < 1)).any(axis=1)
    skin = head_model().in_regions("neck", "shoulder")[faces[:, 0]]
    chosen = faces[bending & skin]
    before, after = mean.vertices_mm, bend_neck([mean], NECK, pose, pose)[0].vertices_mm

    def area(points: Array) -> Array:
        a, b, c = (points[chosen[:, k]].astype(np.float64) for k in range(3))
        return np.asarray(np.cross(b - a, c - a))

    old, new = area(before), area(after)
    ratio = np.linalg.norm(new, axis=1) / np.linalg.norm(old, axis=1)
    assert np.quantile(ratio, 0.002) > 0.2
    assert ratio.max() < 5.0
    # neighbours still face the same way: no triangle is turned over
    edges: dict[tuple[int, int], int] = {}
    flips = 0
    for number, (i, j, k) in enumerate(chosen.tolist()):
        for edge in ((i, j), (j, k), (k, i)):
            other = edges.get((edge[1], edge[0]))
            if other is not None:
                flips += bool(new[number] @ new[other] < 0 < old[number] @ old[other])
            edges[edge] = number
    assert flips <= 0.008 * len(chosen)  # skin creases at the end of the range


def test_where_the_pose_turns_the_trunk_only_motion_bends_the_neck(mean: Mesh) -> None:
    """As in whole people, whose face is not at the origin of their mesh."""
    up = np.array([0.0, 140.0, 90.0], np.float32)  # the face above the base of the neck
    person = Mesh(mean.vertices_mm + up, mean.faces)
    neck = Neck(head_share, (0.0, 140.0, 90.0), trunk_poses=True)
    still = {"yaw_deg": 40.0, "distance_mm": 2000.0, "x_mm": 0.0, "y_mm": 0.0}
    assert bend_neck([person], neck, still, still)[0] is person
    moved = move_pose(still, {"yaw_deg": 8.0, "pitch_deg": -4.0}, neck)
    (turned,) = bend_neck([person], neck, moved, still)
    before, after = (
        1000 * (m.vertices_mm @ pose_matrix(pose)[:3, :3].T + pose_matrix(pose)[:3, 3])
        for m, pose in ((person, still), (turned, moved))
    )
    share = head_share(mean.vertices_mm)
    np.testing.assert_allclose(after[share == 0], before[share == 0], atol=0.01)
    apart = np.linalg.norm(after - before, axis=1)
    assert apart[mean.vertices_mm[:, 2] > 20][:100].min() > 5, "the face turns"
