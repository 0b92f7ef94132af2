"""No light reaches the umbra behind a strip, at any distance, gap and spread of the emitter."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core import depth_map
from glsim.core.camera import Emitter, Intrinsics, SensorRig
from glsim.core.mesh import Mesh
from glsim.core.rect import Rect
from glsim.noise.frame_context import FrameContext
from glsim.noise.numpy_twins.tof_light import tof_shadow
from glsim.noise.registry import find_stage
from glsim.render.renderer import Renderer
from tests.support.scenes import layers_of, rectangle

Image = NDArray[np.float32]

#: The Kinect V2's columns; a few rows are enough.
IMAGE = Intrinsics(512, 12, 365.456, 365.456, 254.878, 6.0)
BASELINE_M, WIDTH_M = 0.045, 0.2
GAPS_M = (0.3, 0.6, 1.0, 1.5, 2.0)
DISTANCES_M = np.arange(0.5, 3.001, 0.05)


def strip_and_wall(front_m: float, wall_m: float) -> list[Mesh]:
    return [rectangle((0, WIDTH_M), (-0.9, 0.9), front_m), rectangle((-9, 9), (-9, 9), wall_m)]


def umbra(front_m: float, wall_m: float, spread_m: float, rays: Image) -> NDArray[np.bool_]:
    """(h, w) pixels of the wall that no point of the emitter reaches, without a rim of 1 px."""
    at = rays[..., 0].astype(np.float64) * wall_m
    pixel_m = front_m / IMAGE.fx  # in the plane of the strip
    dark = rays[..., 0] * front_m < -pixel_m  # left of the strip in the image
    for emitter_m in (BASELINE_M - spread_m, BASELINE_M, BASELINE_M + spread_m):
        crossing = emitter_m + (at - emitter_m) * front_m / wall_m
        dark &= (crossing > pixel_m) & (crossing < WIDTH_M - pixel_m)
    return dark


@pytest.mark.parametrize(
    "spread_m", [0.0, *(pytest.param(s, marks=pytest.mark.long) for s in (0.005, 0.015))]
)
def test_no_light_leaks_into_the_umbra(context: moderngl.Context, spread_m: float) -> None:
    """By the shader, and by its oracle, which marches in the image."""
    rig = SensorRig(IMAGE, (Emitter((BASELINE_M, 0.0, 0.0), spread_m),))
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


def test_no_light_leaks_in_the_walk_of_the_fast_sensor(context: moderngl.Context) -> None:
    """tof_shadow's twin, which the shader agrees with."""
    rig = SensorRig(IMAGE, (Emitter((BASELINE_M, 0.0, 0.0)),))
    renderer, rays, looked_at = Renderer(context, rig), rig.rays(), 0
    declared = find_stage("tof_shadow").parameters
    values = {name: np.float32(parameter.default) for name, parameter in declared.items()}
    for front_m in DISTANCES_M[::2]:
        for gap_m in GAPS_M:
            scene = strip_and_wall(front_m, front_m + gap_m)
            clean = layers_of(context, renderer, scene)["clean"]
            frame = FrameContext.for_frame(
                rig=rig,
                window=Rect(0, 0, IMAGE.width, IMAGE.height),
                seed=1,
                sequence_seed=1,
                device_seed=1,
                nearest_m=0.95 * front_m,
            )
            lit = tof_shadow(frame.view("tof_shadow"), {"clean": clean}, values)["lit"]
            dark = umbra(front_m, front_m + gap_m, 0.001 * values["spread_mm"], rays)
            looked_at += dark.sum()
            assert not (lit[dark] > 1e-6).any(), f"strip at {front_m:.2f} m, wall {gap_m} m behind"
    assert looked_at > 2_000
