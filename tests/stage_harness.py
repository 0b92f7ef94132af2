"""What the tests of noise stages share: running one stage both ways, scenes, and z-scores."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.frame import Rect
from glsim.gl.source import Layer
from glsim.gl.targets import Readback, Target, TargetPool
from glsim.noise.chain import _Pass
from glsim.noise.stage import shipped
from glsim.noise.twins import TWINS
from glsim.noise.view import FrameContext
from glsim.reason import Reason

Image = NDArray[np.float32]
Layers = Mapping[str, Image]

#: A z-score beyond this has a chance of 7e-6: with some hundred scores a run, no false alarms.
Z_MAX = 4.5

WIDTH, HEIGHT = 256, 212
FOCAL_PX, BASELINE_M = 365.456, 0.075

FRAME = FrameContext(
    Rect(0, 0, WIDTH, HEIGHT), WIDTH, HEIGHT, 0x1234_5678_9ABC_DEF0, 77, 4242, 0.0,
    FOCAL_PX * BASELINE_M,
)  # fmt: skip


def frame(seed: int = 0, **changes: object) -> FrameContext:
    """A frame of the tests' size; ``changes`` by the names of FrameContext."""
    return replace(FRAME, seed=FRAME.seed + seed, **changes)  # type: ignore[arg-type]


def values(use: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """All parameters of a shipped stage: the defaults but for ``parameters``."""
    declared = shipped()[use].parameters
    assert set(parameters) <= set(declared)
    return {name: p.default for name, p in declared.items()} | dict(parameters)


def run_twin(use: str, layers: Layers, at: FrameContext = FRAME, **p: float) -> dict[str, Image]:
    """What the twin of a stage writes. Layers are of the window."""
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
def _pass(context: moderngl.Context, use: str) -> _Pass:
    source = shipped()[use].source
    assert source is not None
    return _Pass(context, use, source)


def _upload(pool: TargetPool, name: str, image: Image, window: Rect) -> Target:
    kind = {1: "float", 2: "vec2", 4: "vec4"}[image.shape[2] if image.ndim == 3 else 1]
    source = shipped()["correlation_window"].source
    assert source is not None
    small = next(layer for layer in source.writes)  # the one layer that has another size
    target = pool.take(small if name == small.name else Layer(name, kind), window)
    target.texture.write(np.ascontiguousarray(image).tobytes(), viewport=target.drawn)
    return target


def plane(
    at: FrameContext = FRAME, z_m: float = 0.9, tilt_deg: float = 0.0, turn_deg: float = 0.0
) -> dict[str, Image]:
    """All layers of a plane that fills the window; tilted about y, then turned about the axis."""
    window = at.window
    x = (np.arange(window.left, window.left + window.width) + 0.5 - at.width / 2) / FOCAL_PX
    y = (np.arange(window.top, window.top + window.height) + 0.5 - at.height / 2) / FOCAL_PX
    rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1)
    tilt, turn = np.radians(tilt_deg), np.radians(turn_deg)
    normal = np.array(
        [np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt), 0.0]
    )
    depth = z_m * normal[2] / (rays @ normal[:2] + normal[2])
    return surface(depth.astype(np.float32), rays, normal)


def surface(depth: Image, rays: NDArray[np.float64], normal: NDArray[np.float64]) -> dict[str, Image]:
    """All layers of a depth map, with one normal."""
    valid = depth > 0
    layers = {
        "clean": depth,
        "depth": depth,
        "rays": rays,
        "normal": np.where(valid[..., None], normal, 0.0),
        "albedo": np.where(valid, 0.6, 0.0),
        "lit": valid,
        "reason": np.where(valid, float(Reason.VALID), float(Reason.NO_SURFACE)),
    }
    return {name: np.ascontiguousarray(image, np.float32) for name, image in layers.items()}


def scene(at: FrameContext = FRAME, seed: int = 0) -> dict[str, Image]:
    """A slanted wall, slanted patches before it, nothing beside it, holes, and random signals."""
    rng = np.random.default_rng(seed)
    layers = plane(replace(at, window=Rect(0, 0, at.width, at.height)), 1.4, 35.0, 20.0)
    clean = layers["clean"]
    normal = layers["normal"]
    for _ in range(12):
        left, top = rng.integers(0, at.width - 20), rng.integers(0, at.height - 20)
        rect = Rect(int(left), int(top), int(rng.integers(3, 80)), int(rng.integers(3, 80)))
        patch = plane(
            replace(at, window=Rect(0, 0, at.width, at.height)),
            rng.uniform(0.5, 1.3), rng.uniform(0, 60), rng.uniform(0, 360),
        )  # fmt: skip
        clean[rect.slices] = patch["clean"][rect.slices]
        normal[rect.slices] = patch["normal"][rect.slices]
    clean[:, : at.width // 6] = 0.0
    normal[:, : at.width // 6] = 0.0
    layers |= surface(clean, layers["rays"], normal)
    depth, reason = clean.copy(), layers["reason"]
    holes = (rng.random(clean.shape) < 0.03) & (clean > 0)
    depth[holes], reason[holes] = 0.0, float(Reason.DROPPED)
    layers |= {"depth": depth, "lit": rng.random(clean.shape, np.float32)}
    layers |= {"albedo": rng.random(clean.shape, np.float32)}
    layers |= {"infrared": 200 * rng.random(clean.shape, np.float32)}
    layers |= run_twin("correlation_window", layers, replace(at, window=Rect(0, 0, at.width, at.height)))
    return crop(layers, at)


def crop(layers: Layers, at: FrameContext) -> dict[str, Image]:
    """The window of layers of the whole frame."""
    from glsim.noise.twins.dots import cells

    cut = {name: image[at.window.slices] for name, image in layers.items() if name != "dot_match"}
    if "dot_match" in layers:
        cut["dot_match"] = layers["dot_match"][cells(at.window).slices]
    return {name: np.ascontiguousarray(image) for name, image in cut.items()}
