"""Shadows: soft ones of long emitters, no leaks into an umbra, fewer triangles that cast them."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from moderngl import Context
from numpy.typing import NDArray

from glsim.core import depth_map
from glsim.core.camera import Emitter, Intrinsics, SensorRig
from glsim.core.mesh import KEPT_SHARE, Mesh, occluder_of
from glsim.core.rect import Rect
from glsim.faces.face_source import Face
from glsim.faces.sources.procedural import ProceduralFaces
from glsim.noise.frame_context import FrameContext
from glsim.noise.registry import find_stage
from glsim.noise.twins.tof_light import tof_shadow
from glsim.render.renderer import Renderer
from tests.support.scenes import V2, face_mesh, layers_of, rectangle, rig, sheet

BASELINE_M, SPREAD_M, FRONT_M = 0.045, 0.015, 0.9


def lit_row(context: Context, spread_m: float, wall_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return ``lit`` along the middle row behind a board, by the shader and by marching."""
    rig = SensorRig(V2, (Emitter((BASELINE_M, 0.0, 0.0), spread_m),))
    board = rectangle((0, 0.2), (-0.2, 0.2), FRONT_M)
    layers = layers_of(context, rig, [board, rectangle((-4, 4), (-4, 4), wall_m)])
    return layers["lit"][205], depth_map.lit_by_marching(layers["clean"], rig)[205]


def width_px(baseline_m: float, wall_m: float) -> float:
    """Width of a point's shadow: b f (1 / z_front - 1 / z_wall)."""
    return baseline_m * V2.fx * (1 / FRONT_M - 1 / wall_m)


@pytest.mark.parametrize("wall_m", [1.1, 1.5, 2.0])
def test_the_shadow_has_steps_where_each_point_of_the_emitter_goes(
    context: Context, wall_m: float
) -> None:
    for row in lit_row(context, SPREAD_M, wall_m):
        # The shares count the pixels that two, one and none of the three points reach.
        assert (1 - row).sum() == pytest.approx(width_px(BASELINE_M, wall_m), abs=0.6)
        nearest = width_px(BASELINE_M - SPREAD_M, wall_m)
        assert (row < 0.2).sum() == pytest.approx(nearest, abs=1.1)
        farthest = width_px(BASELINE_M + SPREAD_M, wall_m)
        assert (row < 0.9).sum() == pytest.approx(farthest, abs=1.1)
        levels = row[(row > 0.05) & (row < 0.95)]
        assert len(levels) >= 1, "there is a penumbra"


def test_ends_lie_along_the_baseline() -> None:
    along_y = Emitter((0.0, 0.05, 0.0), 0.01)
    assert along_y.end_m == pytest.approx((0.0, 0.01))
    points, shares = zip(*along_y.shared_points_m(), strict=True)
    np.testing.assert_allclose(points, [[0, 0.04, 0], [0, 0.05, 0], [0, 0.06, 0]])
    assert sum(shares) == pytest.approx(1.0)
    assert len(Emitter((0.0, 0.05, 0.0)).shared_points_m()) == 1


Image = NDArray[np.float32]

#: The Kinect V2's columns; a few rows are enough.
IMAGE = Intrinsics(512, 12, 365.456, 365.456, 254.878, 6.0)
BASELINE_M_LEAK, WIDTH_M = 0.045, 0.2
GAPS_M = (0.3, 0.6, 1.0, 1.5, 2.0)
DISTANCES_M = np.arange(0.5, 3.001, 0.05)


def strip_and_wall(front_m: float, wall_m: float) -> list[Mesh]:
    return [rectangle((0, WIDTH_M), (-0.9, 0.9), front_m), rectangle((-9, 9), (-9, 9), wall_m)]


def umbra(front_m: float, wall_m: float, spread_m: float, rays: Image) -> NDArray[np.bool_]:
    """(h, w) pixels of the wall that no point of the emitter reaches, without a rim of 1 px."""
    at = rays[..., 0].astype(np.float64) * wall_m
    pixel_m = front_m / IMAGE.fx  # in the plane of the strip
    dark = rays[..., 0] * front_m < -pixel_m  # left of the strip in the image
    for emitter_m in (BASELINE_M_LEAK - spread_m, BASELINE_M_LEAK, BASELINE_M_LEAK + spread_m):
        crossing = emitter_m + (at - emitter_m) * front_m / wall_m
        dark &= (crossing > pixel_m) & (crossing < WIDTH_M - pixel_m)
    return dark


@pytest.mark.parametrize(
    "spread_m", [0.0, *(pytest.param(s, marks=pytest.mark.long) for s in (0.005, 0.015))]
)
def test_no_light_leaks_into_the_umbra(context: Context, spread_m: float) -> None:
    """By the shader, and by its oracle, which marches in the image."""
    rig = SensorRig(IMAGE, (Emitter((BASELINE_M_LEAK, 0.0, 0.0), spread_m),))
    renderer, rays, looked_at = Renderer(context, rig), rig.rays(), 0
    for front_m in DISTANCES_M:
        for gap_m in GAPS_M:
            layers = layers_of(context, renderer, strip_and_wall(front_m, front_m + gap_m))
            dark = umbra(front_m, front_m + gap_m, spread_m, rays)
            looked_at += dark.sum()
            place = f"strip at {front_m:.2f} m, wall {gap_m} m behind"
            assert not layers["lit"][dark].any(), f"the shader lights the umbra: {place}"
            marched = depth_map.lit_by_marching(layers["clean"], rig)
            assert not marched[dark].any(), f"marching lights the umbra: {place}"
            lit = (layers["clean"] > front_m + 0.1) & (rays[..., 0] > WIDTH_M / front_m + 0.01)
            assert (layers["lit"][lit] > 0.99).all(), f"the lit side is dark: {place}"
    assert looked_at > 4_000


def test_no_light_leaks_in_the_walk_of_the_fast_sensor(context: Context) -> None:
    """tof_shadow's twin, which the shader agrees with."""
    rig = SensorRig(IMAGE, (Emitter((BASELINE_M_LEAK, 0.0, 0.0)),))
    renderer, rays, looked_at = Renderer(context, rig), rig.rays(), 0
    declared = find_stage("tof_shadow").parameters
    values = {name: np.float32(parameter.default) for name, parameter in declared.items()}
    for front_m in DISTANCES_M[::2]:
        for gap_m in GAPS_M:
            scene = strip_and_wall(front_m, front_m + gap_m)
            clean = layers_of(context, renderer, scene)["clean"]
            seeds = dict.fromkeys(("seed", "sequence_seed", "device_seed"), 1)
            near_m, window = 0.95 * front_m, Rect(0, 0, IMAGE.width, IMAGE.height)
            frame = FrameContext.for_frame(rig=rig, window=window, nearest_m=near_m, **seeds)
            lit = tof_shadow(frame.view("tof_shadow"), {"clean": clean}, values)["lit"]
            dark = umbra(front_m, front_m + gap_m, 0.001 * values["spread_mm"], rays)
            looked_at += dark.sum()
            assert not (lit[dark] > 1e-6).any(), f"strip at {front_m:.2f} m, wall {gap_m} m behind"
    assert looked_at > 2_000


POSE = {"distance_mm": 900.0, "yaw_deg": 15.0}


@pytest.fixture(scope="module")
def heads() -> list[Mesh]:
    """Embedded heads of four people, the last frame of a sequence each: with an expression."""
    source = ProceduralFaces(3)
    keys = [source.frames(subject, 15)[14] for subject in source.subjects(4)]
    return [face.mesh for face in source.load(keys) if isinstance(face, Face)]


def test_the_occluder_is_a_share_of_the_triangles_of_the_same_vertices() -> None:
    mesh = face_mesh()
    occluder = occluder_of(mesh.vertices_mm, mesh.faces)
    assert occluder.dtype == np.int32
    assert len(occluder) == pytest.approx(KEPT_SHARE * len(mesh.faces), rel=0.01)
    assert 0 <= occluder.min() <= occluder.max() < len(mesh.vertices_mm)
    a, b, c = occluder.T
    assert ((a != b) & (b != c) & (c != a)).all()
    np.testing.assert_array_equal(occluder, occluder_of(mesh.vertices_mm, mesh.faces))


def test_the_surface_that_an_emitter_sees_hardly_moves(context: Context, heads: list[Mesh]) -> None:
    """The bounds are twice what the docs quote, which is measured on more faces."""
    renderer = Renderer(context, rig((0.049, 0, 0)))
    moved = []
    for mesh in heads:
        assert mesh.occluder is not None
        whole = layers_of(context, renderer, [(mesh, POSE)])["clean"]
        less = layers_of(context, renderer, [(replace(mesh, faces=mesh.occluder), POSE)])["clean"]
        both = (whole > 0) & (less > 0)
        assert ((whole > 0) != (less > 0)).sum() < 0.005 * both.sum()
        moved.append(1000 * np.abs(whole - less)[both])
    errors_mm = np.concatenate(moved)
    assert np.percentile(errors_mm, 50) < 0.12
    assert np.percentile(errors_mm, 99) < 2.0


def test_the_light_on_a_face_is_nearly_that_of_all_its_triangles(
    context: Context, heads: list[Mesh]
) -> None:
    renderer = Renderer(context, rig((0.15, 0, 0)))
    for mesh in heads:
        found = layers_of(context, renderer, [(mesh, POSE)])
        exact = layers_of(context, renderer, [(replace(mesh, occluder=None), POSE)])
        np.testing.assert_array_equal(found["clean"], exact["clean"])
        seen = exact["clean"] > 0
        dark = (exact["lit"] < 0.5) & seen
        assert dark.sum() > 50, "there is a shadow to compare"
        other = ((found["lit"] < 0.5) != (exact["lit"] < 0.5)) & seen
        assert other.sum() < 0.003 * seen.sum()


def test_the_occluder_casts_no_spots_on_the_face_itself(context: Context) -> None:
    """Where it spans a concave place it rises above the skin: a black spot between the brows."""
    source = ProceduralFaces(1)
    keys = [source.frames(subject, 30)[0] for subject in source.subjects(30)]
    renderer = Renderer(context, rig((0.075, 0, 0), (-0.075, 0, 0)))
    spotted = 0
    for number, face in enumerate(source.load(keys)):
        pose = {"distance_mm": 550.0 + 10 * number, "yaw_deg": 2.0 * (number - 15)}
        found = layers_of(context, renderer, [(face.mesh, pose)])["lit"]
        exact = layers_of(context, renderer, [(replace(face.mesh, occluder=None), pose)])["lit"]
        _, spots = cv2.connectedComponents(((found < 0.3) & (exact > 0.7)).astype(np.uint8))
        spotted += int((np.bincount(spots.ravel())[1:] >= 4).any())
    assert spotted <= 1


def test_the_occluder_alone_casts_the_shadow(context: Context) -> None:
    """A plate whose occluder is its upper half casts half of its shadow on a wall."""
    plate = sheet(lambda x, _: np.full_like(x, 0.9), (-0.1, 0.1), (-0.12, 0.12), cells=2)
    wall = rectangle((-5, 5), (-5, 5), 1.5)
    renderer = Renderer(context, rig((0.075, 0, 0)))

    def dark(mesh: Mesh) -> int:
        return int((layers_of(context, renderer, [mesh, wall])["lit"] < 0.5).sum())

    whole = dark(plate)
    middle_mm = plate.vertices_mm[plate.faces, 1].mean(axis=1)
    half = replace(plate, occluder=plate.faces[middle_mm > 0])
    assert whole > 500
    assert dark(half) == pytest.approx(0.5 * whole, rel=0.05)
    # The same triangles with another occluder, or none, are another entry of the cache.
    assert dark(plate) == whole
    assert dark(replace(plate, occluder=plate.faces)) == whole
