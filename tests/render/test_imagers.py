"""Imagers: what each sees, the light of each projector there, borders, and wrong rigs."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from moderngl import Context
from numpy.typing import NDArray

from glsim.bench.scenes import occluder
from glsim.core.camera import Emitter, Intrinsics, SensorRig
from glsim.core.errors import ConfigError
from glsim.core.mesh import Mesh
from glsim.core.pose import pose_matrix
from glsim.core.rect import Rect
from glsim.gl.targets import Readback
from glsim.render.renderer import Renderer
from glsim.sensors.sensor import load_sensor
from glsim.settings.schema import load_settings, with_assignments
from glsim.simulation.pipeline import open_sources, simulate
from glsim.simulation.plan.tasks import make_tasks
from tests.support.scenes import rig_toml

IMAGE = Intrinsics(200, 150, 180.0, 180.0, 100.0, 75.0)
RIG = SensorRig(
    IMAGE,
    (Emitter((0.02, 0.0, 0.0)), Emitter((0.05, 0.0, 0.0))),
    imagers_m=((0.0, 0.0, 0.0), (0.06, 0.0, 0.0)),
)
NAMES = ("clean", "left_clean", "left_lit", "right_clean", "right_normal", "right_lit")


def scene(near_mm: float = 500, far_mm: float = 900) -> list[tuple[Mesh, NDArray[np.float32]]]:
    mesh = occluder(near_mm, far_mm, 60.0)
    signs = np.array([1, -1, -1], np.float32)
    return [(Mesh(mesh.vertices_mm * signs, mesh.faces, mesh.albedo), pose_matrix({}))]


def layers(
    context: Context, rig: SensorRig, names: Sequence[str] = NAMES, **asked: object
) -> tuple[dict[str, NDArray[np.float32]], Rect]:
    readback = Readback(context)
    with Renderer(context, rig).render(scene(), **asked) as rendered:  # type: ignore[arg-type]
        targets = {name: rendered.layers[name] for name in names}
        readback.request(rendered.pool, targets, rendered.window)
        return {n: a.copy() for n, a in readback.arrays().items()}, rendered.window


def test_each_imager_sees_the_scene_from_its_place(context: Context) -> None:
    found, _ = layers(context, RIG)
    np.testing.assert_array_equal(found["left_clean"], found["clean"])
    moved = [(mesh, view.copy()) for mesh, view in scene()]
    moved[0][1][0, 3] -= 0.06
    readback = Readback(context)
    with Renderer(context, replace(RIG, imagers_m=(), emitters=())).render(moved) as rendered:
        readback.request(rendered.pool, {"clean": rendered.layers["clean"]}, rendered.window)
        alone = readback.arrays()["clean"]
    np.testing.assert_array_equal(found["right_clean"], alone)
    # A foreground at 0.5 m lies f B / z = 21.6 px farther left.
    near = [np.flatnonzero(found[f"{s}_clean"][75] < 0.6) for s in ("left", "right")]
    assert near[0][0] - near[1][0] in (21, 22)


def test_the_light_of_each_projector_is_kept_apart(context: Context) -> None:
    """To the left of the foreground lies the shadow of a projector to its right, as wide as far."""
    found, _ = layers(context, RIG)
    row = found["left_lit"][75]
    far = found["left_clean"][75] > 0.8
    widths = [(far & (row[:, k] < 0.5)).sum() for k in (0, 1)]
    per_metre = 180 * (1 / 0.5 - 1 / 0.9)
    assert widths[0] == pytest.approx(0.02 * per_metre, abs=1.5)
    assert widths[1] == pytest.approx(0.05 * per_metre, abs=1.5)
    # The right imager stands at 0.06 m: its shadows are as wide as its distance to a projector.
    row, far = found["right_lit"][75], found["right_clean"][75] > 0.8
    assert (far & (row[:, 0] < 0.5)).sum() == pytest.approx(0.04 * per_metre, abs=1.5)
    assert (far & (row[:, 1] < 0.5)).sum() == pytest.approx(0.01 * per_metre, abs=1.5)


def test_a_crop_s_window_holds_what_the_other_imager_sees_of_it(context: Context) -> None:
    crop = Rect(80, 50, 40, 40)
    whole, _ = layers(context, RIG)
    cut, window = layers(context, RIG, visible=crop, reach_px=10)
    assert window.left <= 80 - 10 - 21  # the foreground's disparity
    assert window.left + window.width < 200
    for name, image in cut.items():
        if name.endswith("lit"):  # edges of shadows move with the grid of the z-buffer
            assert (np.abs(image - whole[name][window.slices]) > 0.3).mean() < 0.01
        else:
            np.testing.assert_array_equal(image, whole[name][window.slices])


def test_borders_are_seen_by_imagers_and_not_delivered() -> None:
    sensor = load_sensor("truedepth")
    canvas = sensor.rig.canvas()
    left, top, right, bottom = sensor.rig.border_px
    assert canvas.intrinsics.width == 640 + left + right
    assert canvas.intrinsics.height == 480 + top + bottom
    settings = load_settings(
        None, [], {"sensor": "truedepth", "pose": {"distance_mm": 300}, "output": {}},
        {"subjects": 1, "frames_per_subject": 1},
    )  # fmt: skip
    sources = open_sources(settings)
    (whole,) = simulate(settings, sources=sources)
    assert whole.noisy.shape == (480, 640)
    assert whole.intrinsics == sensor.rig.intrinsics
    seen = whole.clean > 0
    assert (whole.noisy[seen] > 0).mean() > 0.9
    assert (whole.noisy[-20:][seen[-20:]] > 0).mean() > 0.9  # no band at the lower border
    (cut,) = simulate(with_assignments(settings, {"output.crop": 160}), sources=sources)
    image = cut.intrinsics
    x, y = round(sensor.rig.intrinsics.cx - image.cx), round(sensor.rig.intrinsics.cy - image.cy)
    part = (slice(y, y + 160), slice(x, x + 160))
    np.testing.assert_array_equal(cut.clean, whole.clean[part])
    both = (cut.noisy > 0) & (whole.noisy[part] > 0)
    assert both.mean() > 0.8
    off = np.abs(cut.noisy[both].astype(int) - whole.noisy[part][both])
    assert (off > 2).mean() < 0.01


@pytest.mark.parametrize("sensor", ["realsense-d435", "truedepth"])
def test_frames_are_the_same_bytes_in_any_order(sensor: str) -> None:
    settings = load_settings(
        None, [], {"sensor": sensor, "output": {"crop": 160}, "devices": 2},
        {"subjects": 2, "frames_per_subject": 2},
    )  # fmt: skip
    sources = open_sources(settings)
    tasks = make_tasks(settings, sources)
    made = [list(simulate(settings, order, sources=sources)) for order in (tasks, tasks[::-1])]
    for one, other in zip(made[0], made[1][::-1], strict=True):
        assert one.noisy.tobytes() == other.noisy.tobytes()
        assert one.infrared.tobytes() == other.infrared.tobytes()
    assert made[0][0].noisy.tobytes() != made[0][1].noisy.tobytes()


BASE = f"""
title = "t"
{rig_toml(64, 48, 60)}
{{rig}}
[[stage]]
use = "{{light}}"
[[stage]]
use = "{{exposure}}"
[[stage]]
use = "match_stereo"
"""
IMAGER = "[[rig.imager]]\nposition_m = [{}, {}, 0]\n"
EMITTER = "[[rig.emitter]]\nposition_m = [{}, {}, 0]\n"


@pytest.mark.parametrize(
    ("rig", "kind", "message"),
    [
        (IMAGER.format(0, 0), "pattern", "matches two views, but the rig has 1 imagers and 0 emit"),
        (IMAGER.format(0, 0), "stereo", "reads the layer 'right_clean', but the rig has 1 of the"),
        (IMAGER.format(0, 0) * 2, "stereo", "along rows or columns"),
        (IMAGER.format(0, 0) + IMAGER.format(0.05, 0.02), "stereo", "along x or along y alone"),
        (IMAGER.format(0, 0) + IMAGER.format(0.05, 0) * 2, "stereo", "two of each at most"),
        (
            "supersample = 3\n" + IMAGER.format(0, 0) + IMAGER.format(0.05, 0),
            "stereo", "supersample",
        ),
        (
            IMAGER.format(0, 0) + IMAGER.format(0.05, 0) + "[rig.distortion]\nk1 = 0.1\n",
            "stereo", "no lens distortion",
        ),
        (EMITTER.format(0.05, 0), "stereo", "reads the layer 'left_clean', but the rig has 0 of"),
    ],
)  # fmt: skip
def test_rigs_that_cannot_be_matched_get_one_clear_line(
    tmp_path: Path, rig: str, kind: str, message: str
) -> None:
    file = tmp_path / "s.toml"
    file.write_text(BASE.format(rig=rig, light=f"{kind}_light", exposure=f"{kind}_exposure"))
    with pytest.raises(ConfigError, match=message):
        load_sensor(str(file))
