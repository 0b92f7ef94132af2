"""Shadows: widths by formula, sides, levels, no self-shadowing, the NumPy oracle."""

import numpy as np
import pytest
from moderngl import Context
from numpy.typing import NDArray

from glsim.core import depth_map
from glsim.core.mesh import Mesh
from glsim.render.renderer import Renderer
from tests.support.scenes import V2, Plane, face_mesh, interior, layers_of, rectangle, rig, sphere

NEAR_M = 0.9
STEP = (-0.1, 0.1), (-0.12, 0.12)


def step_scene(background_m: float) -> list[Mesh]:
    return [rectangle(*STEP, NEAR_M), rectangle((-5, 5), (-5, 5), background_m)]


def occluder_rows_and_columns() -> tuple[slice, slice]:
    corners = V2.project(np.array([[x, y, NEAR_M] for x, y in zip(*STEP, strict=True)]))
    (left, top), (right, bottom) = corners.round().astype(int)
    return slice(top, bottom), slice(left, right)


@pytest.mark.parametrize("background_m", [1.0, 1.1, 1.5, 2.0])
@pytest.mark.parametrize("baseline_m", [0.045, 0.075, -0.075])
def test_width_behind_a_step_is_that_of_the_formula(
    context: Context, baseline_m: float, background_m: float
) -> None:
    """Pixels = b f (1/Zo - 1/Zb), on the side of the occluder away from the emitter only."""
    lit = layers_of(context, rig((baseline_m, 0, 0)), step_scene(background_m))["lit"]
    expected = abs(baseline_m) * V2.fx * (1 / NEAR_M - 1 / background_m)
    rows, columns = occluder_rows_and_columns()
    # Away from the occluder's upper and lower edges, where the shadow's ends differ.
    middle = slice(rows.start + 10, rows.stop - 10)
    width = (1 - lit[middle]).sum(axis=1)
    assert np.abs(width - expected).max() <= 1.0
    dark = np.flatnonzero((lit[middle] < 0.5).any(axis=0))
    beside = columns.start - 1 if baseline_m > 0 else columns.stop
    away = -1 if baseline_m > 0 else 1
    np.testing.assert_array_equal(dark, sorted(beside + away * np.arange(len(dark))))
    assert (lit[: rows.start - 2] == 1).all()
    assert (lit[rows.stop + 2 :] == 1).all()


def test_a_vertical_baseline_throws_shadows_up_and_none_aside(context: Context) -> None:
    lit = layers_of(context, rig((0, 0.075, 0)), step_scene(1.5))["lit"]
    rows, columns = occluder_rows_and_columns()
    dark = np.argwhere(lit < 0.5)
    assert dark[:, 0].max() == rows.start - 1
    expected = 0.075 * V2.fy * (1 / NEAR_M - 1 / 1.5)
    assert np.ptp(dark[:, 0]) + 1 == pytest.approx(expected, abs=1)
    assert dark[:, 1].min() >= columns.start - 1
    assert dark[:, 1].max() <= columns.stop


def test_without_an_emitter_everything_is_lit(context: Context) -> None:
    assert (layers_of(context, rig(), step_scene(1.5))["lit"] == 1).all()


def test_each_of_several_emitters_gives_its_share(context: Context) -> None:
    places = [(x, 0.0, 0.0) for x in (0.03, 0.06, 0.09)]
    together = layers_of(context, rig(*places), step_scene(1.5))["lit"]
    alone = [layers_of(context, rig(place), step_scene(1.5))["lit"] for place in places]
    np.testing.assert_allclose(together, np.mean(alone, axis=0), atol=1e-6)
    row = together[205, :215]
    for share in (0, 1 / 3, 2 / 3, 1):
        assert (np.abs(row - share) < 1e-3).sum() >= 2


@pytest.mark.parametrize("emitter", [(0.045, 0.0, 0.0), (0.075, 0.0, 0.0), (0.0, -0.075, 0.0)])
@pytest.mark.parametrize("tilt", [0, 30, 60, 75])
@pytest.mark.parametrize("turn", [0, 45, 90, 180, 290])
def test_a_plane_does_not_shadow_itself(
    context: Context, tilt: float, turn: float, emitter: tuple[float, float, float]
) -> None:
    layers = layers_of(context, rig(emitter), [Plane(0.9, tilt, turn).mesh(0.1, cells=24)])
    inside = interior(layers["clean"], 1)
    assert inside.sum() > 5000
    assert (layers["lit"][inside] < 1).mean() < 0.001


def angle_to_emitter(
    clean_m: NDArray[np.float32],
    normal: NDArray[np.floating],
    emitter_m: tuple[float, float, float],
) -> NDArray[np.float64]:
    """Cosine of the angle between the normal and the direction to the emitter."""
    rays = np.concatenate([V2.rays(), np.ones((V2.height, V2.width, 1))], axis=-1)
    way = np.asarray(emitter_m) - rays * clean_m[..., None]
    cosine = (normal * way).sum(-1) / np.linalg.norm(way, axis=-1)
    return np.asarray(cosine, np.float64)


@pytest.mark.parametrize("distance_m", [0.6, 1.0, 2.5])
def test_a_sphere_does_not_shadow_itself_and_is_dark_on_the_far_side(
    context: Context, distance_m: float
) -> None:
    """The emitter is far aside, so the terminator is in view."""
    centre, emitter = (0.02, 0.01, distance_m), (0.4, 0.1, 0.0)
    layers = layers_of(context, rig(emitter), [sphere(centre, 0.12, 200)])
    rays = np.concatenate([V2.rays(), np.ones((V2.height, V2.width, 1))], axis=-1)
    outward = (rays * layers["clean"][..., None] - centre) / 0.12
    cosine = angle_to_emitter(layers["clean"], outward, emitter)
    inside = interior(layers["clean"], 1)
    facing = inside & (cosine > np.cos(np.radians(75)))
    turned_away = inside & (cosine < -0.05)
    assert facing.sum() > 500
    assert turned_away.sum() > 40 or distance_m > 2
    assert (layers["lit"][facing] < 1).mean() < 0.001
    assert not layers["lit"][turned_away].any()


SCENES: dict[str, list[Mesh | tuple[Mesh, dict[str, float]]]] = {
    "face": [(face_mesh(), {"distance_mm": 900.0, "yaw_deg": 25.0})],
    "face and wall": [(face_mesh(), {"distance_mm": 800.0}), rectangle((-5, 5), (-5, 5), 1.3)],
    "step": [*step_scene(1.5)],
}


@pytest.mark.parametrize("emitters", [[(0.075, 0, 0)], [(0.04, 0, 0), (0.06, 0, 0)]])
@pytest.mark.parametrize("name", SCENES)
def test_marching_in_the_image_agrees_with_the_shader(
    context: Context, name: str, emitters: list[tuple[float, float, float]]
) -> None:
    """depth_map.lit_by_marching sees the depth map only, without the surfaces hidden behind it."""
    device = rig(*emitters)
    layers = layers_of(context, device, SCENES[name])
    marched = depth_map.lit_by_marching(layers["clean"], device)
    seen = layers["clean"] > 0
    same = np.abs(marched - layers["lit"])[seen] < 0.3
    assert same.mean() > 0.99
    if name != "face":  # of shadows, which are few: their edges differ by half a pixel a side
        dark, found = (layers["lit"] < 0.7)[seen], (marched < 0.7)[seen]
        assert (dark & found).sum() > 0.9 * (dark | found).sum() > 150


def test_lighting_a_depth_map_is_like_lighting_its_mesh(context: Context) -> None:
    device = rig((0.075, 0, 0))
    layers = layers_of(context, device, SCENES["face and wall"])
    clean = layers["clean"]
    renderer = Renderer(context, device)
    normal, surface = depth_map.normals(clean, device.rays()), depth_map.surface(clean, device)
    with renderer.light_depth_map(clean, normal, surface) as again:
        lit = np.frombuffer(again.layers["lit"].texture.read(), np.float32).reshape(clean.shape)
    dark, found = ((image < 0.5)[clean > 0] for image in (layers["lit"], lit))
    assert (dark & found).sum() > 0.8 * (dark | found).sum() > 150
