"""What the tests of noise stages share: running one stage both ways, scenes, and z-scores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.frame import Rect
from glsim.gl.source import Layer
from glsim.gl.targets import Readback, Target, TargetPool
from glsim.noise.chain import StagePass
from glsim.noise.stage import shipped
from glsim.noise.twins import TWINS
from glsim.noise.twins.dots import cells
from glsim.noise.view import FrameContext
from glsim.reason import Reason

Image = NDArray[np.float32]
Layers = Mapping[str, Image]

#: A z-score beyond this has a chance of 7e-6: with some hundred scores a run, no false alarms.
Z_MAX = 4.5

WIDTH, HEIGHT = 256, 212
WHOLE = Rect(0, 0, WIDTH, HEIGHT)
FOCAL_PX, BASELINE_M = 365.456, 0.075
FOCAL_BASELINE = FOCAL_PX * BASELINE_M


def frame(seed: int = 0, **changes: Any) -> FrameContext:
    """A frame of the tests' size; ``changes`` by the names of FrameContext."""
    at = FrameContext(WHOLE, WIDTH, HEIGHT, 0x123456789ABC + seed, 77, 4242, 0.0, FOCAL_BASELINE)
    return replace(at, **changes)


FRAME = frame()


def values(use: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """All parameters of a shipped stage: the defaults but for ``parameters``."""
    declared = shipped()[use].parameters
    assert set(parameters) <= set(declared)
    return {name: p.default for name, p in declared.items()} | dict(parameters)


def run_twin(use: str, layers: Layers, at: FrameContext = FRAME, **p: float) -> dict[str, Image]:
    """What the twin of a stage writes. Layers are of the window."""
    with np.errstate(all="raise"):
        return TWINS[use](at.view(use), layers, values(use, p))


def run_shader(
    context: moderngl.Context, use: str, layers: Layers, at: FrameContext = FRAME, **p: float
) -> dict[str, Image]:
    """What the shader of a stage writes. Layers are of the window."""
    pool = _pool(context, at.width, at.height)
    targets = {name: _upload(pool, name, image, at.window) for name, image in layers.items()}
    context.enable_only(moderngl.NOTHING)
    written = _pass(context, use).draw(pool, targets, at, values(use, p))
    readback = Readback(context)
    readback.request(pool, written, at.window)
    arrays = {name: array.copy() for name, array in readback.arrays().items()}
    for target in (*targets.values(), *written.values()):
        pool.give_back(target)
    return arrays


@lru_cache(maxsize=8)
def _pool(context: moderngl.Context, width: int, height: int) -> TargetPool:
    return TargetPool(context, width, height)


@lru_cache(maxsize=32)
def _pass(context: moderngl.Context, use: str) -> StagePass:
    source = shipped()[use].source
    assert source is not None
    return StagePass(context, use, source)


def _upload(pool: TargetPool, name: str, image: Image, window: Rect) -> Target:
    layer = Layer(name, {1: "float", 2: "vec2", 4: "vec4"}[image.shape[2] if image.ndim > 2 else 1])
    if name == "dot_match":
        source = shipped()["correlation_window"].source
        assert source is not None
        layer = source.writes[0]
    target = pool.take(layer, window)
    target.texture.write(np.ascontiguousarray(image).tobytes(), viewport=target.drawn)
    return target


def flat(
    depth_m: float | NDArray[np.floating], angle_deg: float = 0.0, at: FrameContext = FRAME
) -> dict[str, Image]:
    """All layers of a window with the depths given and one angle between normal and axis.

    They need not fit together: stages look at each for itself.
    """
    angle = np.radians(angle_deg)
    return layers_of(
        np.broadcast_to(depth_m, (at.window.height, at.window.width)),
        np.array([np.sin(angle), 0.0, -np.cos(angle), 0.0]),
        at,
    )


def layers_of(
    depth: NDArray[np.floating], normal: NDArray[np.floating], at: FrameContext = FRAME
) -> dict[str, Image]:
    """All layers of a surface of skin, fully lit, from depths and normals (h, w, 4) of the window.

    The rays are a pinhole's with the centre in the middle of the frame.
    """
    valid = depth > 0
    layers = {
        "clean": depth,
        "depth": depth,
        "rays": rays(at),
        "normal": np.where(valid[..., None], normal, 0.0),
        "albedo": np.where(valid, 0.6, 0.0),
        "lit": valid,
        "reason": np.where(valid, float(Reason.VALID), float(Reason.NO_SURFACE)),
    }
    return {name: np.array(image, np.float32) for name, image in layers.items()}


def rays(at: FrameContext = FRAME) -> NDArray[np.float64]:
    """(h, w, 2) x/z and y/z of each pixel of the window."""
    left, top, width, height = at.window
    x = (left + np.arange(width) + 0.5 - at.width / 2) / FOCAL_PX
    y = (top + np.arange(height) + 0.5 - at.height / 2) / FOCAL_PX
    return np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1)


def plane(
    z_m: float, tilt_deg: float, turn_deg: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Depth and normal of a plane through the axis at z, over the whole frame."""
    tilt, turn = np.radians(tilt_deg), np.radians(turn_deg)
    normal = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt), 0])
    return z_m * normal[2] / (rays() @ normal[:2] + normal[2]), normal


def scene(seed: int = 0) -> dict[str, Image]:
    """A slanted wall, slanted patches before it, nothing beside it, holes, and random signals."""
    rng = np.random.default_rng(seed)
    depth, direction = plane(1.4, 35.0, 20.0)
    normal = np.broadcast_to(direction, (*depth.shape, 4)).copy()
    for _ in range(12):
        size, low = rng.integers(3, 80, 2), rng.integers(0, (WIDTH - 20, HEIGHT - 20))
        rect = Rect(int(low[0]), int(low[1]), int(size[0]), int(size[1])).slices
        patch, direction = plane(rng.uniform(0.5, 1.3), rng.uniform(0, 60), rng.uniform(0, 360))
        depth[rect], normal[rect] = patch[rect], direction
    depth[:, : WIDTH // 6] = 0.0
    layers = layers_of(depth, normal)
    holes = (rng.random(depth.shape) < 0.03) & (depth > 0)
    layers["depth"][holes], layers["reason"][holes] = 0.0, float(Reason.DROPPED)
    layers["lit"], layers["albedo"], light = rng.random((3, *depth.shape), np.float32)
    return {**layers, "infrared": 200 * light, **run_twin("correlation_window", layers)}


def crop(layers: Layers, at: FrameContext) -> dict[str, Image]:
    """The window of layers of the whole frame."""
    return {
        name: image[(cells(at.window) if name == "dot_match" else at.window).slices].copy()
        for name, image in layers.items()
    }


def z_mean(samples: NDArray[Any], expected: float = 0.0) -> float:
    """How many standard errors the mean of independent samples is away from ``expected``."""
    numbers = np.asarray(samples, np.float64).ravel()
    return float((numbers.mean() - expected) / (numbers.std() / np.sqrt(numbers.size)))


def z_sd(samples: NDArray[Any], expected: float) -> float:
    """The same of the standard deviation of normal samples, in its own standard errors."""
    numbers = np.asarray(samples, np.float64).ravel()
    return float((numbers.std(ddof=1) / expected - 1.0) * np.sqrt(2.0 * (numbers.size - 1)))


def z_rate(hits: NDArray[np.bool_], expected: float) -> float:
    """The same of the share of hits."""
    error = np.sqrt(expected * (1.0 - expected) / hits.size)
    return float((hits.mean() - expected) / error)


def z_correlation(a: NDArray[Any], b: NDArray[Any]) -> float:
    """The same of the correlation of samples that should have none."""
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1] * np.sqrt(a.size))
