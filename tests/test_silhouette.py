"""Passes that skip what lies outside the silhouette leave the same bytes as those that do not."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest
from test_tof_agreement import SENSORS, face_scenes
from tof_harness import Camera, quad

from glsim.frame import Rect

MULTIPATH = {"tof_multipath": {"enabled": 1.0, "samples": 8.0}}


def everywhere(cam: Camera, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have the whole window drawn from now on."""
    draw = cam.renderer.silhouette.draw

    def draw_and_forget(*arguments: object) -> None:
        draw(*arguments)  # type: ignore[arg-type]
        cam.renderer.silhouette.leaves_out = False

    monkeypatch.setattr(cam.renderer.silhouette, "draw", draw_and_forget)


@pytest.mark.parametrize("sensor", SENSORS)
def test_the_same_bytes_come_out(
    context: moderngl.Context, monkeypatch: pytest.MonkeyPatch, sensor: str
) -> None:
    cam, scenes = Camera.open(context, sensor), face_scenes(2, seed=3)
    changes = MULTIPATH if sensor == "kinect-v2" else {}
    skipped = [cam.shoot(scene, changes, seed=7) for scene in scenes]
    assert cam.renderer.silhouette.leaves_out
    everywhere(cam, monkeypatch)
    for scene, some in zip(scenes, skipped, strict=True):
        for name, whole in cam.shoot(scene, changes, seed=7).items():
            np.testing.assert_array_equal(some[name], whole, name)


def test_a_smaller_face_leaves_nothing_of_a_larger_one(context: moderngl.Context) -> None:
    """Targets are used again; what was drawn in them before must be gone."""
    cam, scene = Camera.open(context), [quad(900.0, (-40, 40), (-40, 40))]
    alone = cam.shoot(scene)
    cam.shoot([quad(900.0, (-300, 300), (-200, 200))])
    again = cam.shoot(scene)
    for name, image in alone.items():
        np.testing.assert_array_equal(image, again[name], name)


def test_a_background_leaves_nothing_out(context: moderngl.Context) -> None:
    cam = Camera.open(context)
    cam.shoot([quad(900.0)])
    assert not cam.renderer.silhouette.leaves_out
    cam.shoot([quad(900.0, (-40, 40), (-40, 40))])
    assert cam.renderer.silhouette.leaves_out


def test_its_edge_is_a_pixel_outside(context: moderngl.Context) -> None:
    """The blur's light one pixel beside what the camera sees is kept."""
    cam = Camera.open(context)
    layers = cam.shoot([quad(900.0, (-40, 40), (-40, 40))])
    rows, columns = np.nonzero(layers["phasor_b"][..., 2] > 0)
    seen = np.nonzero(layers["clean"] > 0)
    box = Rect(columns.min(), rows.min(), np.ptp(columns) + 1, np.ptp(rows) + 1)
    inner = Rect(seen[1].min(), seen[0].min(), np.ptp(seen[1]) + 1, np.ptp(seen[0]) + 1)
    assert box.contains(inner)
    assert 1 <= box.width - inner.width <= 4
