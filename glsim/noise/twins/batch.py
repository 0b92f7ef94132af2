"""Batches of depth maps: seeds as words, values sampled per map, lights beside the camera."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import log
from typing import Any

from glsim.core.arrays import of
from glsim.core.errors import ConfigError
from glsim.core.seeds import stage_seed
from glsim.noise.frame_context import FrameContext
from glsim.noise.twins.layers import Image, Words, normal_pair, pcg_word, uniform01
from glsim.settings.distribution import Distribution

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
