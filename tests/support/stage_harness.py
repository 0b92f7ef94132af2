"""Helpers of the tests of noise stages: run shader and twin, make scenes, compute z-scores."""

from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from typing import Any

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.gl.declarations import Layer
from glsim.gl.targets import Readback, Target, TargetPool
from glsim.noise.frame_context import FrameContext
from glsim.noise.layer_names import IMAGE_CONSTANTS
from glsim.noise.registry import shipped_stages
from glsim.noise.stage_pass import StagePass
from glsim.noise.twins import find_twin
from glsim.noise.twins.batch import WordContext, seed_word
from glsim.noise.twins.edges import cells

Image = NDArray[np.float32]
Layers = Mapping[str, Image]

#: The probability of a z-score beyond this is 7e-6: no false alarms in some hundred per run.
Z_MAX = 4.5

WIDTH, HEIGHT = 256, 212
WHOLE = Rect(0, 0, WIDTH, HEIGHT)
FOCAL_PX, BASELINE_M = 365.456, 0.075
FOCAL_BASELINE = FOCAL_PX * BASELINE_M


def frame(seed: int = 0, **changes: Any) -> FrameContext:
    """Make the context of a frame of the tests' size, with changed fields."""
    at = FrameContext(
        window=WHOLE,
        width=WIDTH,
        height=HEIGHT,
        seed=0x123456789ABC + seed,
        sequence_seed=77,
        device_seed=4242,
        time_s=0.0,
        focal_baseline_px_m=FOCAL_BASELINE,
        second_view_m=(BASELINE_M, 0.0, 0.0),
    )
    return replace(at, **changes)


FRAME = frame()


def values(use: str, parameters: Mapping[str, float]) -> dict[str, float]:
    """Return all parameters of a shipped stage, ``parameters`` or defaults."""
    declared = shipped_stages()[use].parameters
    assert set(parameters) <= set(declared)
    return {name: p.default for name, p in declared.items()} | dict(parameters)


def run_twin(use: str, layers: Layers, at: FrameContext = FRAME, **p: float) -> dict[str, Image]:
    """Return the layers that a stage's twin writes, (h, w) of the window."""
    twin = find_twin(use)
    assert twin is not None
    with np.errstate(all="raise"):
        return twin(at.view(use), layers, values(use, p))


def run_on_tensors(
    use: str, layers: Layers, at: FrameContext = FRAME, **p: float
) -> dict[str, Image]:
    """Return what ``run_twin`` does, from the second map of a batch of PyTorch tensors."""
    torch = pytest.importorskip("torch")
    batch = {
        name: torch.from_numpy(np.stack([0.9 * image, image])) for name, image in layers.items()
    }
    seeds = {
        name: torch.tensor([[[7]], [[np.uint32(seed_word(getattr(at, name))).view(np.int32)]]],
                           dtype=torch.int32)
        for name in ("seed", "sequence_seed", "device_seed")
    }  # fmt: skip
    twin = find_twin(use)
    assert twin is not None
    number = {name: float(np.float32(value)) for name, value in values(use, p).items()}
    written = twin(WordContext(**{**at.__dict__, **seeds}).view(use), batch, number)
    return {name: image[-1].numpy() for name, image in written.items()}


def run_shader(
    context: moderngl.Context, use: str, layers: Layers, at: FrameContext = FRAME, **p: float
) -> dict[str, Image]:
    """Return the layers that a stage's shader writes, (h, w) of the window.

    Those of IMAGE_CONSTANTS have a size of their own.
    """
    pool = _pool(context, at.width, at.height)
    images = {name: layers[name] for name in IMAGE_CONSTANTS if name in layers}
    lent = {n: _upload(pool, n, v, at.window) for n, v in layers.items() if n not in images}
    targets = lent | {name: _image(context, name, v) for name, v in images.items()}
    context.enable_only(moderngl.NOTHING)
    stage = _pass(context, use, "expected" in layers, tuple(images))
    written = stage.draw(pool, targets, at, values(use, p))
    readback = Readback(context)
    readback.request(pool, written, at.window)
    arrays = {name: array.copy() for name, array in readback.arrays().items()}
    for target in (*lent.values(), *written.values()):
        pool.give_back(target)
    return arrays


@lru_cache(maxsize=8)
def _pool(context: moderngl.Context, width: int, height: int) -> TargetPool:
    return TargetPool(context, width, height)


@lru_cache(maxsize=32)
def _pass(
    context: moderngl.Context, use: str, expected: bool, images: tuple[str, ...]
) -> StagePass:
    source = shipped_stages()[use].source
    assert source is not None
    if source.uses("EXPECTED"):
        source = source.with_defines(EXPECTED=1) if expected else source.without("expected")
    for name in images:
        source = source.with_defines(**{IMAGE_CONSTANTS[name]: 1})
    return StagePass(context, use, source)


def _image(context: moderngl.Context, name: str, image: Image) -> Target:
    height, width = image.shape
    texture = context.texture((width, height), 1, np.ascontiguousarray(image).tobytes(), dtype="f4")
    texture.filter = (moderngl.NEAREST, moderngl.NEAREST)
    return Target(texture, Layer(name, "float"), Rect(0, 0, width, height))


def _upload(pool: TargetPool, name: str, image: Image, window: Rect) -> Target:
    layer = Layer(name, {1: "float", 2: "vec2", 4: "vec4"}[image.shape[2] if image.ndim > 2 else 1])
    if name == "dot_match":
        source = shipped_stages()["correlation_window"].source
        assert source is not None
        layer = source.writes[0]
    target = pool.take(layer, window)
    target.texture.write(np.ascontiguousarray(image).tobytes(), viewport=target.drawn)
    return target


def flat(
    depth_m: float | NDArray[np.floating], angle_deg: float = 0.0, at: FrameContext = FRAME
) -> dict[str, Image]:
    """Make all layers of a window from depths and one angle between normal and axis.

    Depths and normals may contradict each other: stages read each on its own.
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
    """Make all layers of lit skin from depths and normals (h, w, 4) of a window.

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
    """Compute x/z and y/z of each pixel of the window, (h, w, 2)."""
    left, top, width, height = at.window
    x = (left + np.arange(width) + 0.5 - at.width / 2) / FOCAL_PX
    y = (top + np.arange(height) + 0.5 - at.height / 2) / FOCAL_PX
    return np.stack(np.broadcast_arrays(x[None, :], y[:, None]), axis=-1)


def plane(
    z_m: float, tilt_deg: float, turn_deg: float = 0.0
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Compute depth (m) and normal of a plane that crosses the axis at ``z_m``, whole frame."""
    tilt, turn = np.radians(tilt_deg), np.radians(turn_deg)
    normal = np.array([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), -np.cos(tilt), 0])
    return z_m * normal[2] / (rays() @ normal[:2] + normal[2]), normal


def scene(seed: int = 0) -> dict[str, Image]:
    """Make layers of a slanted wall, slanted patches before it, empty columns and holes."""
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
    return {
        **layers,
        "infrared": 970 * light,
        "fate": np.where(light < 0.1, np.float32(Reason.SHADOW), np.float32(0)),
        "disparity": np.where(depth > 0, FOCAL_BASELINE / np.where(depth > 0, depth, 1), 0).astype(
            np.float32
        ),
        **run_twin("correlation_window", layers),
    }


def crop(layers: Layers, at: FrameContext) -> dict[str, Image]:
    """Cut the window of ``at`` from layers of the whole frame."""
    return {
        name: image[(cells(at.window) if name == "dot_match" else at.window).slices].copy()
        for name, image in layers.items()
    }


def z_mean(samples: NDArray[Any], expected: float = 0.0) -> float:
    """Compute the deviation of the mean of samples from ``expected``, in standard errors."""
    numbers = np.asarray(samples, np.float64).ravel()
    return float((numbers.mean() - expected) / (numbers.std() / np.sqrt(numbers.size)))


def z_sd(samples: NDArray[Any], expected: float) -> float:
    """Compute the deviation of the standard deviation of normal samples, in standard errors."""
    numbers = np.asarray(samples, np.float64).ravel()
    return float((numbers.std(ddof=1) / expected - 1.0) * np.sqrt(2.0 * (numbers.size - 1)))


def z_rate(hits: NDArray[np.bool_], expected: float) -> float:
    """Compute the deviation of the share of hits from ``expected``, in standard errors."""
    error = np.sqrt(expected * (1.0 - expected) / hits.size)
    return float((hits.mean() - expected) / error)


def z_correlation(a: NDArray[Any], b: NDArray[Any]) -> float:
    """Compute the deviation of a correlation of samples from 0, in standard errors."""
    return float(np.corrcoef(a.ravel(), b.ravel())[0, 1] * np.sqrt(a.size))
