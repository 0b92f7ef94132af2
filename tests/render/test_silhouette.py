"""Passes that skip the pixels outside the silhouette leave the same bytes as those that do not."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import moderngl
import numpy as np
import pytest

from glsim.core.rect import Rect
from glsim.render.silhouette import Silhouette
from tests.support.tof_harness import Camera, Placed, face_scenes, quad

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
    context: moderngl.Context, monkeypatch: pytest.MonkeyPatch, sensor: str
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


def test_a_smaller_face_leaves_nothing_of_a_larger_one(context: moderngl.Context) -> None:
    """Targets are reused; what was drawn in them before must be cleared."""
    cam, scene = Camera.open(context), [quad(900.0, (-40, 40), (-40, 40))]
    alone = cam.shoot(scene)
    cam.shoot([quad(900.0, (-300, 300), (-200, 200))])
    again = cam.shoot(scene)
    for name, image in alone.items():
        np.testing.assert_array_equal(image, again[name], name)


def test_a_background_leaves_nothing_out(context: moderngl.Context) -> None:
    cam = Camera.open(context)
    assert not skips_empty(cam, [quad(900.0)])
    assert skips_empty(cam, [quad(900.0, (-40, 40), (-40, 40))])


def test_its_edge_is_a_pixel_outside(context: moderngl.Context) -> None:
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
