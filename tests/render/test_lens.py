"""Lenses, samples and silhouettes: edges land where OpenCV puts them, skipped pixels stay blank."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import cv2
import numpy as np
import pytest
from moderngl import Context

from glsim.core.camera import Distortion
from glsim.core.rect import Rect
from glsim.render.silhouette import Silhouette
from tests.support.scenes import V2, V2_LENS, Plane, interior, layers_of, rectangle, rig
from tests.support.tof_harness import Camera, Placed, face_scenes, quad

RAW = rig((0.075, 0, 0), distortion=V2_LENS, deliver="raw")


def opencv_pixels(points_m: np.ndarray) -> np.ndarray:
    matrix = np.array([[V2.fx, 0, V2.cx], [0, V2.fy, V2.cy], [0, 0, 1]])
    lens = np.array([V2_LENS.k1, V2_LENS.k2, V2_LENS.p1, V2_LENS.p2, V2_LENS.k3])
    seen, _ = cv2.projectPoints(points_m, np.zeros(3), np.zeros(3), matrix, lens)
    return np.asarray(seen[:, 0])


def test_a_renderer_inverts_its_lens_once(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    lens = Distortion(k1=0.08, k2=-0.2, k3=0.0713)  # used by no other test, so not cached
    invert, made = Distortion.undistort, []

    def counted(self: Distortion, xy: np.ndarray) -> np.ndarray:
        made.append(invert(self, xy))
        return made[-1]

    monkeypatch.setattr(Distortion, "undistort", counted)
    device = rig((0.075, 0, 0), distortion=lens, deliver="raw")
    layers_of(context, device, [Plane(1.2, 35, 30).mesh(1.0)])
    assert len(made) == 1
    assert device.rays().tobytes() == made[0].astype(np.float32).tobytes()


def test_a_plane_stays_a_plane(context: Context) -> None:
    plane = Plane(1.2, 35, 30)
    layers = layers_of(context, RAW, [plane.mesh(1.0)])
    seen = layers["clean"] > 0
    assert seen.mean() > 0.8
    error_mm = 1000 * np.abs(layers["clean"] - plane.depth(RAW.rays()))[seen]
    assert error_mm.max() < 0.01
    assert np.abs(layers["normal"][seen][:, :3] - plane.normal).max() < 1e-4


@pytest.mark.parametrize(
    ("x", "y"),
    [
        pytest.param((-0.1, 0.1), (-0.1, 0.1), id="middle"),
        pytest.param((0.45, 0.6), (0.4, 0.5), id="lower right"),
        pytest.param((-0.65, -0.5), (-0.5, -0.4), id="upper left"),
        pytest.param((0.6, 0.66), (0.48, 0.53), id="corner"),
        pytest.param((0.71, 0.73), (-0.1, 0.1), id="beyond the pinhole's image"),
    ],
)
def test_edges_land_where_opencv_puts_them(
    context: Context, x: tuple[float, float], y: tuple[float, float]
) -> None:
    """The outline agrees within a pixel, and all pixels except those on the outline."""
    drawn = layers_of(context, RAW, [rectangle(x, y, 1.0)])["clean"] > 0
    rays = RAW.rays().astype(np.float64)
    inset = 1.0 / V2.fx  # more than half a pixel, less than two even where the lens stretches
    for grow, expected in ((-inset, True), (inset, False)):
        within = (np.abs(rays[..., 0] - np.mean(x)) < (x[1] - x[0]) / 2 + grow) & (
            np.abs(rays[..., 1] - np.mean(y)) < (y[1] - y[0]) / 2 + grow
        )
        assert (drawn[within] if expected else ~drawn[~within]).all()
    rows, columns = np.nonzero(drawn)
    edge = np.linspace(0, 1, 50)
    outline = [(x[0], y[0] + t * (y[1] - y[0]), 1) for t in edge]
    outline += [(x[1], y[0] + t * (y[1] - y[0]), 1) for t in edge]
    outline += [(x[0] + t * (x[1] - x[0]), v, 1) for v in y for t in edge]
    there = np.clip(opencv_pixels(np.array(outline)), 0, (V2.width, V2.height))
    np.testing.assert_allclose(
        [columns.min(), rows.min(), columns.max() + 1, rows.max() + 1],
        [*there.min(axis=0), *there.max(axis=0)],
        atol=1.0,
    )


@pytest.mark.parametrize("side", [1, -1])
def test_shadows_are_as_wide_as_without_the_lens(context: Context, side: int) -> None:
    scene = [rectangle((-0.1, 0.1), (-0.12, 0.12), 0.9), rectangle((-3, 3), (-3, 3), 1.5)]
    emitter = (0.075 * side, 0.0, 0.0)
    plain = layers_of(context, rig(emitter), scene)["lit"] < 0.5
    through = layers_of(context, rig(emitter, distortion=V2_LENS, deliver="raw"), scene)
    dark = through["lit"] < 0.5
    width = dark[190:220].sum(axis=1)
    assert np.abs(width - plain[190:220].sum(axis=1)).max() <= 1
    # Nothing else is dark, neither beside the occluder's other edge nor at the image's borders.
    assert dark.sum() == pytest.approx(plain.sum(), rel=0.08)


def test_the_number_of_samples_reaches_the_shader(context: Context) -> None:
    """The range of a slanted plane within a pixel is (n - 1) / n of its change per pixel."""
    three, five = (
        layers_of(context, replace(rig(), supersample=samples), [Plane(0.9, 30).mesh(0.1)])
        for samples in (3, 5)
    )
    inside = interior(three["clean"])
    ratio = np.median((five["uneven"] / np.maximum(three["uneven"], 1e-9))[inside])
    assert ratio == pytest.approx((4 / 5) / (2 / 3), rel=0.05)


MULTIPATH = {"tof_multipath": {"enabled": 1.0, "samples": 8.0}}


def skips_empty(cam: Camera, scene: Sequence[Placed]) -> bool:
    with cam.renderer.render(scene) as rendered:
        return rendered.silhouette.skips_empty


def draw_everywhere(cam: Camera, monkeypatch: pytest.MonkeyPatch) -> None:
    """Make passes draw the whole window from now on."""
    silhouettes = cam.renderer._silhouettes
    draw = silhouettes.draw

    @contextmanager
    def draw_whole(*arguments: object) -> Iterator[Silhouette]:
        with draw(*arguments) as silhouette:  # type: ignore[arg-type]
            silhouette.skips_empty = False
            yield silhouette

    monkeypatch.setattr(silhouettes, "draw", draw_whole)


@pytest.mark.parametrize("sensor", ["kinect-v2", "kinect-v2-fast", "azure-kinect"])
def test_the_same_bytes_come_out(
    context: Context, monkeypatch: pytest.MonkeyPatch, sensor: str
) -> None:
    cam, scenes = Camera.open(context, sensor), face_scenes(2, seed=3)
    changes = MULTIPATH if sensor == "kinect-v2" else {}
    skipped = [cam.shoot(scene, changes, seed=7) for scene in scenes]
    assert all(skips_empty(cam, scene) for scene in scenes)
    draw_everywhere(cam, monkeypatch)
    assert not any(skips_empty(cam, scene) for scene in scenes)
    for scene, some in zip(scenes, skipped, strict=True):
        for name, whole in cam.shoot(scene, changes, seed=7).items():
            np.testing.assert_array_equal(some[name], whole, name)


def test_a_smaller_face_leaves_nothing_of_a_larger_one(context: Context) -> None:
    """Targets are reused; what was drawn in them before must be cleared."""
    cam, scene = Camera.open(context), [quad(900.0, (-40, 40), (-40, 40))]
    alone = cam.shoot(scene)
    cam.shoot([quad(900.0, (-300, 300), (-200, 200))])
    again = cam.shoot(scene)
    for name, image in alone.items():
        np.testing.assert_array_equal(image, again[name], name)


def test_a_background_leaves_nothing_out(context: Context) -> None:
    cam = Camera.open(context)
    assert not skips_empty(cam, [quad(900.0)])
    assert skips_empty(cam, [quad(900.0, (-40, 40), (-40, 40))])


def test_its_edge_is_a_pixel_outside(context: Context) -> None:
    """The blurred light one pixel outside the visible surface is kept."""
    cam = Camera.open(context)
    layers = cam.shoot([quad(900.0, (-40, 40), (-40, 40))])
    rows, columns = np.nonzero(layers["phasor_b"][..., 2] > 0)
    seen = np.nonzero(layers["clean"] > 0)
    box, inner = (
        Rect(int(x.min()), int(y.min()), int(np.ptp(x)) + 1, int(np.ptp(y)) + 1)
        for y, x in ((rows, columns), seen)
    )
    assert box.contains(inner)
    assert 1 <= box.width - inner.width <= 4
