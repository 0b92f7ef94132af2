"""The camera's layers against geometry: planes, spheres, directions, reflectivity, bad meshes."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from moderngl import Context

from glsim.core.camera import Intrinsics
from glsim.core.errors import MeshError
from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.core.rect import Rect
from glsim.render.renderer import Rendered, Renderer
from tests.support.scenes import (
    AT_CAMERA,
    V2,
    V2_LENS,
    Plane,
    camera_mesh,
    face_mesh,
    grid_faces,
    interior,
    layers_of,
    rectangle,
    rig,
)

RAYS = V2.rays().astype(np.float64)


@pytest.mark.parametrize(("tilt", "turn"), [(0, 0), *product((40, 75), (0, 90, 200))])
def test_plane_is_exact_to_a_micrometre(context: Context, tilt: float, turn: float) -> None:
    plane = Plane(0.9, tilt, turn)
    layers = layers_of(context, rig(), [plane.mesh(0.12)])
    inside = interior(layers["clean"])
    assert inside.sum() > 8000
    assert np.abs(layers["clean"] - plane.depth(RAYS))[inside].max() < 1e-6
    assert np.abs(layers["normal"][inside][:, :3] - plane.normal).max() < 1e-4


def test_first_row_is_on_top_and_columns_go_right(context: Context) -> None:
    clean = layers_of(context, rig(), [rectangle((0.1, 0.2), (-0.3, -0.1), 1.0)])["clean"]
    rows, columns = np.nonzero(clean)
    corners = V2.project(np.array([[0.1, -0.3, 1.0], [0.2, -0.1, 1.0]]))
    # A pixel is drawn if its centre is covered.
    assert columns.min() == round(corners[0, 0])
    assert columns.max() == round(corners[1, 0]) - 1
    assert rows.min() == round(corners[0, 1])
    assert rows.max() == round(corners[1, 1]) - 1


def test_the_subjects_left_is_on_the_right_of_the_image(context: Context) -> None:
    """Canonical +x, where the cheek has a bump, and +y, where the forehead is."""
    face = layers_of(context, rig(), [(face_mesh(), {"distance_mm": 900})])["clean"]
    row, right, left = (
        round(V2.project(np.array([[x / 1000, 0.025, 0.88]]))[0][axis])
        for x, axis in ((0, 1), (45, 0), (-45, 0))
    )
    assert 0.001 < face[row, left] - face[row, right] < 0.01
    nose = np.unravel_index(np.where(face > 0, face, 9).argmin(), face.shape)
    tip = V2.project(np.array([[0.0, 0.012, 0.85]]))[0]
    np.testing.assert_allclose(nose, (tip[1] - 0.5, tip[0] - 0.5), atol=1.6)


@pytest.mark.parametrize(
    ("angle", "nearer"), [("yaw_deg", (60.0, 0.0)), ("pitch_deg", (0.0, 80.0)), ("roll_deg", None)]
)
def test_poses_turn_the_head_as_its_owner_would_say(
    angle: str, nearer: tuple[float, float] | None
) -> None:
    """Yaw brings the right cheek nearer, pitch the chin; roll moves the crown to image right."""
    view = pose_matrix({angle: 20.0, "distance_mm": 900})

    def seen(x: float, y: float, z: float) -> np.ndarray:
        return np.asarray(view @ np.array([x, y, z, 1]))

    if nearer is None:
        assert seen(0, 100, 0)[0] > 0.03
    else:
        x, y = nearer
        assert seen(-x, -y, 0)[2] < 0.9 < seen(x, y, 0)[2]
        nose = seen(0, 0, 50)
        assert nose[0] > 0.015 if angle == "yaw_deg" else nose[1] < -0.015


def test_albedo_is_interpolated_between_vertices_or_that_of_skin(context: Context) -> None:
    plain = rectangle((-0.2, 0.2), (-0.2, 0.2), 1.0)
    grey = Mesh(plain.vertices_mm, plain.faces, np.array([0, 1, 0, 1], np.float32))
    for mesh in (grey, plain, grey):  # the same topology: the buffers are used again
        layers = layers_of(context, rig(), [mesh])
        inside = interior(layers["clean"])
        expected = (RAYS[..., 0] + 0.2) / 0.4 if mesh is grey else np.full(RAYS.shape[:2], 0.6)
        np.testing.assert_allclose(layers["albedo"][inside], expected[inside], atol=1e-5)


def test_new_vertices_of_a_known_topology_are_drawn(context: Context) -> None:
    renderer = Renderer(context, rig())
    near = rectangle((-0.1, 0.1), (-0.1, 0.1), 0.8)
    far = Mesh(near.vertices_mm * np.array([1, 1, 1.5], np.float32), near.faces)
    deep = [layers_of(context, renderer, [mesh])["clean"].max() for mesh in (near, far, near)]
    np.testing.assert_allclose(deep, [0.8, 1.2, 0.8], atol=1e-6)


def test_the_nearer_mesh_hides_the_farther_in_any_order(context: Context) -> None:
    near, far = rectangle((-0.1, 0.1), (-0.1, 0.1), 0.8), rectangle((-2, 2), (-2, 2), 1.5)
    one = layers_of(context, rig((0.05, 0, 0)), [near, far])
    other = layers_of(context, rig((0.05, 0, 0)), [far, near])
    for name in ("clean", "normal", "albedo", "lit"):
        np.testing.assert_array_equal(one[name], other[name])
    covered = (np.abs(RAYS) < 0.1 / 0.8).all(axis=-1)
    np.testing.assert_allclose(one["clean"], np.where(covered, 0.8, 1.5), atol=1e-6)


@pytest.mark.parametrize("lens", [{}, {"distortion": V2_LENS, "deliver": "raw"}])
@pytest.mark.parametrize("offset_m", [(0.0, 0.0), (0.5, 0.3), (-0.6, -0.5)])
def test_a_crop_is_cut_from_the_same_image(
    context: Context, offset_m: tuple[float, float], lens: dict[str, Any]
) -> None:
    renderer = Renderer(context, rig((0.045, 0, 0), **lens))
    x, y = offset_m
    pose = {"distance_mm": 900, "x_mm": 1000 * x, "y_mm": 1000 * y}
    scene: list[Any] = [(face_mesh(60), pose), rectangle((-3, 3), (-3, 3), 1.2)]
    whole = layers_of(context, renderer, scene)
    centre = V2.project(np.array([[x, y, 0.9]]))[0].astype(int)
    crop = Rect(int(np.clip(centre[0] - 40, 0, 432)), int(np.clip(centre[1] - 40, 0, 344)), 80, 80)
    part = layers_of(context, renderer, scene, crop)
    assert part["window"][2:].max() <= 80 + 40
    for name in ("clean", "normal", "albedo", "lit"):
        np.testing.assert_array_equal(part[name][crop.slices], whole[name][crop.slices])


@pytest.mark.parametrize(
    ("points", "message"),
    [
        pytest.param([[np.nan, 0, 1]], "3 vertices are NaN or infinite: repair", id="nan"),
        pytest.param([[0, np.inf, 1]], "3 vertices are NaN or infinite: repair", id="inf"),
        pytest.param([[0, 0, -1]], r"lies behind the camera .*z -1000 to -1000 mm", id="behind"),
        pytest.param([[0, 0, 0.05]], "nearer than 100 mm .* units, axes and distance", id="near"),
        pytest.param([[5, 0, 1]], "out of view: it would span columns 2082 to 2082 ", id="right"),
        pytest.param([[0, -5, 1]], "out of view: .* of 512x424", id="above"),
        pytest.param([[1e9, 0, 1e3]], "out of view", id="large"),
    ],
)
def test_what_cannot_be_drawn_is_named(
    context: Context, points: list[list[float]], message: str
) -> None:
    mesh = camera_mesh(np.array(points * 3), np.array([[0, 1, 2]]))
    with pytest.raises(MeshError, match=message):
        layers_of(context, rig(), [mesh])


def test_a_mesh_outside_of_the_crop_is_out_of_view(context: Context) -> None:
    mesh = rectangle((0.3, 0.4), (-0.1, 0.1), 1.0)
    with pytest.raises(MeshError, match=r"out of view: .* of the crop of 64x64 at 10, 20"):
        layers_of(context, rig(), [mesh], Rect(10, 20, 64, 64))


def test_a_mesh_that_passes_the_camera_is_drawn_where_it_is_in_front(context: Context) -> None:
    floor = camera_mesh(
        np.array([[-1, 0.3, 3.0], [1, 0.3, 3.0], [-1, 0.3, -3.0], [1, 0.3, -3.0]]), grid_faces(2, 2)
    )
    clean = layers_of(context, rig(), [floor])["clean"]
    assert not clean[:200].any()
    rows = RAYS[300:, 256, 1]
    np.testing.assert_allclose(clean[300:, 256], 0.3 / rows, rtol=1e-5)
    lit = layers_of(context, rig((0.045, 0, 0)), [floor])["lit"]
    assert (lit[300:, 256] > 0.99).all()  # the emitter stands above the floor: no shadow


def test_further_meshes_behind_or_beside_the_camera_are_no_error(context: Context) -> None:
    """Shoes and knees of a person who sits near, before a face that is in view."""
    face = camera_mesh(
        np.array([[-0.1, -0.1, 0.9], [0.1, -0.1, 0.9], [-0.1, 0.1, 0.9], [0.1, 0.1, 0.9]]),
        grid_faces(2, 2),
    )
    alone = layers_of(context, rig((0.045, 0, 0)), [face])
    for nearest, farthest in ((-0.3, 0.06), (0.03, 0.5)):
        shoe = camera_mesh(
            np.array([
                [-0.1, 0.8, farthest], [0.1, 0.8, farthest],
                [-0.1, 0.8, nearest], [0.1, 0.8, nearest],
            ]),
            grid_faces(2, 2),
        )  # fmt: skip
        layers = layers_of(context, rig((0.045, 0, 0)), [face, shoe])
        seen = alone["clean"] > 0
        np.testing.assert_array_equal(layers["clean"][seen], alone["clean"][seen])
        assert (layers["lit"][seen] > 0.99).mean() > 0.99


def test_an_emitter_inside_a_scene_before_the_camera_is_an_error(context: Context) -> None:
    floor = camera_mesh(
        np.array([[-1, 0.3, 3.0], [1, 0.3, 3.0], [-1, 0.3, 0.2], [1, 0.3, 0.2]]), grid_faces(2, 2)
    )
    with pytest.raises(MeshError, match=r"behind the emitter at .*0.5"):
        layers_of(context, rig((0.0, 0, 0.5)), [floor])


def test_large_coordinates_keep_their_precision(context: Context) -> None:
    """A scan in a world frame: 10 m from its origin, brought back by the pose."""
    plain = rectangle((-0.1, 0.1), (-0.1, 0.1), 0.0)
    away = Mesh(plain.vertices_mm + np.float32(10_000), plain.faces)
    pose = {"distance_mm": 900 + 10_000, "x_mm": -10_000, "y_mm": 10_000}
    clean = layers_of(context, rig(), [(away, pose)])["clean"]
    np.testing.assert_allclose(clean[interior(clean)], 0.9, atol=2e-6)


def test_a_view_of_one_pixel_in_a_large_image(context: Context) -> None:
    wide = Intrinsics(3000, 8, 900.0, 900.0, 1500.0, 4.0)
    clean = layers_of(context, rig(image=wide), [rectangle((1.2, 1.2 + 1 / 900), (-1, 1), 1.0)])[
        "clean"
    ]
    assert (clean > 0).any(axis=0).sum() == 1


def lent(rendered: Rendered) -> set[int]:
    """The textures of the layers."""
    return {target.texture.glo for target in rendered.layers.values()}


@pytest.mark.parametrize("samples", [1, 3])
def test_targets_are_free_again_when_the_block_is_left(context: Context, samples: int) -> None:
    renderer = Renderer(context, rig((0.05, 0, 0), supersample=samples))
    scene = [(rectangle((-0.1, 0.1), (-0.1, 0.1), 0.8), AT_CAMERA)]
    with renderer.render(scene) as first:
        textures = lent(first)
        with renderer.render(scene) as second:
            assert not lent(second) & textures
            assert second.silhouette is not first.silhouette
    behind_emitter = [*scene, (rectangle((-1, 1), (-1, 1), -0.5), AT_CAMERA)]
    for failing in (behind_emitter, scene):
        with pytest.raises((MeshError, ValueError)), renderer.render(failing):
            raise ValueError("stop")
    with renderer.render(scene) as again:
        assert lent(again) == textures
        assert again.silhouette is first.silhouette


def test_the_scene_comes_with_its_window_and_nearest_depth(context: Context) -> None:
    renderer = Renderer(context, rig((0.05, 0, 0)))
    near, far = (rectangle((-0.1, 0.1), (-0.1, 0.1), z) for z in (0.8, 1.6))
    with renderer.render([(near, AT_CAMERA)]) as one, renderer.render([(far, AT_CAMERA)]) as other:
        assert one.nearest_m == pytest.approx(0.8)
        assert other.nearest_m == pytest.approx(1.6)
        assert one.window.contains(other.window)
        assert {"clean", "normal", "albedo", "lit"} == set(one.layers)


def test_a_two_sided_mesh_may_be_wound_at_random(context: Context) -> None:
    mesh = face_mesh()
    mixed = np.where(np.arange(len(mesh.faces))[:, None] % 10 == 0, mesh.faces[:, ::-1], mesh.faces)
    mixed = np.ascontiguousarray(mixed)
    turned = [mesh, replace(mesh, faces=mixed), replace(mesh, faces=mixed.copy(), two_sided=True)]
    at = {"distance_mm": 900.0}
    plain, holes, whole = (layers_of(context, rig((0.05, 0, 0)), [(m, at)]) for m in turned)
    assert (holes["clean"] == 0).sum() > (plain["clean"] == 0).sum() + 100
    for name in ("clean", "normal", "lit"):
        np.testing.assert_allclose(whole[name], plain[name], atol=1e-4)
