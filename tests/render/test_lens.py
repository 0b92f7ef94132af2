"""Frames that keep their lens distortion: planes stay planes, edges land where OpenCV puts them."""

from __future__ import annotations

import cv2
import moderngl
import numpy as np
import pytest

from glsim.core.camera import Distortion
from tests.support.scenes import V2, V2_LENS, Plane, layers_of, rectangle, rig

RAW = rig((0.075, 0, 0), distortion=V2_LENS, deliver="raw")


def opencv_pixels(points_m: np.ndarray) -> np.ndarray:
    matrix = np.array([[V2.fx, 0, V2.cx], [0, V2.fy, V2.cy], [0, 0, 1]])
    lens = np.array([V2_LENS.k1, V2_LENS.k2, V2_LENS.p1, V2_LENS.p2, V2_LENS.k3])
    seen, _ = cv2.projectPoints(points_m, np.zeros(3), np.zeros(3), matrix, lens)
    return np.asarray(seen[:, 0])


def test_a_renderer_inverts_its_lens_once(
    context: moderngl.Context, monkeypatch: pytest.MonkeyPatch
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


def test_a_plane_stays_a_plane(context: moderngl.Context) -> None:
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
    context: moderngl.Context, x: tuple[float, float], y: tuple[float, float]
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
def test_shadows_are_as_wide_as_without_the_lens(context: moderngl.Context, side: int) -> None:
    scene = [rectangle((-0.1, 0.1), (-0.12, 0.12), 0.9), rectangle((-3, 3), (-3, 3), 1.5)]
    emitter = (0.075 * side, 0.0, 0.0)
    plain = layers_of(context, rig(emitter), scene)["lit"] < 0.5
    through = layers_of(context, rig(emitter, distortion=V2_LENS, deliver="raw"), scene)
    dark = through["lit"] < 0.5
    width = dark[190:220].sum(axis=1)
    assert np.abs(width - plain[190:220].sum(axis=1)).max() <= 1
    # Nothing else is dark, neither beside the occluder's other edge nor at the image's borders.
    assert dark.sum() == pytest.approx(plain.sum(), rel=0.08)
