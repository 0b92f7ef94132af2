"""Batches of depth maps: their seeds as words, what is sampled per map, normals and shadows."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import log
from typing import Any

from glsim.core.errors import ConfigError
from glsim.core.seeds import stage_seed
from glsim.noise.frame_context import FrameContext
from glsim.noise.twins.arrays import of
from glsim.noise.twins.layers import Image, Words, normal_pair, pcg_word, uniform01
from glsim.settings.distribution import Distribution

#: Depth difference between neighbouring pixels that separates surfaces, relative to the depth, and
#: the least distance, m, of a surface before a line of light; both as in ``glsim.core.depth_map``.
_EDGE_SHARE, _SHADOW_BIAS_M = 0.03, 0.003
#: Largest part of an emitter's distance from the camera across its main axis, as of imagers.
_MOST_SKEW = 1e-3


class WordContext(FrameContext):
    """The context of a frame, or of a batch of maps (B, H, W), whose seeds are 32-bit words.

    Args:
        seed, sequence_seed, device_seed: integers of a frame; words (B, 1, 1) of a batch, or
            (1, 1, 1) for all its maps.
        focal_px, focal_baseline_px_m: of a batch numbers, or (B, 1, 1).
    """

    def view(self, stage: str) -> WordContext:
        """Return the context with the seeds of the stage of this name.

        ``stage_seed`` is a checksum: for two seeds it differs by the same bits for all stages, so
        that this is the view of a FrameContext with the seeds that ``seed_word`` is given.
        """
        own = stage_seed(0, stage)
        own = of(self.seed).word(own) if self.batched else own
        names = ("seed", "sequence_seed", "device_seed")
        return replace(self, **{n: getattr(self, n) ^ own for n in names})


def seed_word(seed: int) -> int:
    """Return the word that stands for a seed of 64 bits in a WordContext."""
    return stage_seed(seed, "") ^ stage_seed(0, "")


def map_words(seed: int, seeds: Any, frames: Any) -> tuple[Words, Words]:
    """Return a word per map and frame, and one per map that all its frames share.

    Args:
        seed: of the settings.
        seeds, frames: (B,) integers of the maps, arrays or tensors; of 32 bits, others wrap around.
    """
    xp = of(seeds)
    held = pcg_word(pcg_word(xp.words(seeds)) ^ xp.word(seed_word(seed)))
    return pcg_word(held ^ pcg_word(xp.words(frames))), held


def sample(setting: Distribution, name: str, words: Mapping[str, Words]) -> Image:
    """Sample a number per map, (B,), from a distribution that is not constant.

    Args:
        name: of the parameter, "stage.parameter".
        words: "frame" and the other scopes -> (B,) words of ``map_words``.
    """
    word = words["frame" if setting.per == "frame" else "held"]
    xp = of(word)
    word = pcg_word(word ^ xp.word(zlib.crc32(name.encode())))
    share = uniform01(word)
    if setting.normal is not None:
        mean, sigma = setting.normal
        return mean + sigma * xp.clip(normal_pair(word, pcg_word(word))[0], -3.0, 3.0)
    if setting.choice is not None:
        number = xp.integers(xp.floor(share * len(setting.choice)))
        return xp.vector(setting.choice, share)[number]
    if setting.loguniform is not None:
        low, high = map(log, setting.loguniform)
        return xp.exp(low + (high - low) * share)
    assert setting.uniform is not None
    low, high = setting.uniform
    return low + (high - low) * share


def surface_normals(depth_m: Image, rays: Image) -> Image:
    """Compute (B, H, W, 3) unit normals towards the camera, as ``depth_map.normals`` does.

    Args:
        depth_m: (B, H, W) metres, 0 = no depth.
        rays: (1 or B, H, W, 2) x/z, y/z.
    """
    xp = of(depth_m)
    points = [rays[..., 0] * depth_m, rays[..., 1] * depth_m, depth_m]
    steps = []
    for axis in (-1, -2):
        ahead = [xp.roll(part, -1, axis) for part in points]
        last = depth_m.shape[axis] - 1
        place = xp.range(0, last + 1, depth_m)
        place = place if axis == -1 else place[:, None]
        least = xp.minimum(depth_m, ahead[2])
        same = (least > 0) & (xp.abs(ahead[2] - depth_m) <= _EDGE_SHARE * least) & (place < last)
        step = [xp.where(same, b - a, 0.0) for a, b in zip(points, ahead, strict=True)]
        count = xp.floats(same) + xp.floats(xp.roll(same, 1, axis))
        alone = (1.0, 0.0, 0.0) if axis == -1 else (0.0, 1.0, 0.0)
        steps.append(
            [
                xp.where(count > 0, (part + xp.roll(part, 1, axis)) / xp.maximum(count, 1.0), axle)
                for part, axle in zip(step, alone, strict=True)
            ]
        )
    (ax, ay, az), (bx, by, bz) = steps
    normal = [by * az - bz * ay, bz * ax - bx * az, bx * ay - by * ax]
    length = xp.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    outwards = sum(n * point for n, point in zip(normal, points, strict=True))
    known = (depth_m > 0) & (length > 0)
    scale = xp.where(outwards > 0, -1.0, 1.0) / xp.where(known, length, 1.0)
    flat = (0.0, 0.0, -1.0)
    return xp.stack([xp.where(known, n * scale, f) for n, f in zip(normal, flat, strict=True)], -1)


def beside_camera(point_m: Sequence[float]) -> tuple[int, int, float]:
    """Return the image axis (-1 along rows, -2) to a light, the way along it, and its distance, m.

    Raises ConfigError for a light that is not straight beside, above or below the camera.
    """
    x, y, z = point_m
    axis, along, across = (-1, x, y) if abs(x) >= abs(y) else (-2, y, x)
    if abs(across) > _MOST_SKEW * abs(along) or abs(z) > _MOST_SKEW:
        raise ConfigError(
            f"an emitter at {tuple(point_m)} m: on tensors it must be straight beside, above or "
            'below the camera: take backend="egl" or "osmesa"'
        )
    return axis, 1 if along > 0 else -1, abs(along)


def lit_share(
    depth_m: Image,
    focal_px: Any,
    lights: Sequence[tuple[int, int, Any, float]],
    bias_m: Any = _SHADOW_BIAS_M,
) -> Image:
    """Compute the (B, H, W) share of light that reaches each pixel from lights beside the camera.

    The line from a surface point to such a light follows a row or a column of the image, and
    1 / depth grows by the same step per pixel on it. A pixel is in shadow if a pixel ahead reaches
    above its line: objects count as thick.

    Args:
        focal_px: along the row or column, a number or (B, 1, 1).
        lights: of each light the first two of ``beside_camera``, its distance from the camera, m, a
            number or (B, 1, 1), and its share.
        bias_m: how far a surface lies before the lines that it blocks, at least.
    """
    xp = of(depth_m)
    seen = depth_m > 0
    inverse = 1.0 / xp.where(seen, depth_m, 1.0)
    lit = xp.zeros_like(depth_m)
    for axis, way, baseline_m, share in lights:
        last = depth_m.shape[axis] - 1
        place = xp.floats(xp.range(0, last + 1, depth_m))
        place = place if axis == -1 else place[:, None]
        height = inverse - way * place / xp.maximum(focal_px * baseline_m, 1e-3)
        reaching = xp.where(seen, height, -1e6)
        reaching = reaching.flip(axis) if way > 0 else reaching
        highest = xp.roll(reaching.cummax(axis).values, 1, axis)
        highest = highest.flip(axis) if way > 0 else highest
        hidden = (highest - height > bias_m * inverse * inverse) & (place != max(last * way, 0))
        lit = lit + share * xp.floats(~hidden)
    return xp.where(seen, lit, 0.0)
