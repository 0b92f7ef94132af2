"""Batches of depth maps: seeds as 32-bit words, values per map, lights beside the camera."""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import log
from typing import Any

from glsim.core.arrays import Words, of
from glsim.core.errors import ConfigError
from glsim.core.seeds import stage_seed
from glsim.noise.frame_context import FrameContext
from glsim.noise.twins.layers import Image, normal_pair, pcg_word, uniform01
from glsim.settings.distribution import Distribution

#: Largest offset of an emitter across its main axis, as a share of its distance, and largest offset
#: along the optical axis, m. Chosen: rectified imagers are aligned as well as this.
_MOST_SKEW = 1e-3


class WordContext(FrameContext):
    """The context of a frame, or of a batch of maps (B, H, W), whose seeds are 32-bit words.

    Args:
        seed, sequence_seed, device_seed: integers for a frame; for a batch words (B, 1, 1), or
            (1, 1, 1) if all maps share them.
        focal_px, focal_baseline_px_m: numbers; for a batch also (B, 1, 1).
    """

    def view(self, stage: str) -> WordContext:
        """Return the context with a stage's seeds: each one XOR the stage's checksum."""
        # CRC32 is linear, so this equals ``FrameContext.view`` of the seeds behind these words.
        checksum = stage_seed(0, stage)
        checksum = of(self.seed).word(checksum) if self.batched else checksum
        names = ("seed", "sequence_seed", "device_seed")
        return replace(self, **{n: getattr(self, n) ^ checksum for n in names})


def seed_word(seed: int) -> int:
    """Convert a 64-bit seed to the 32-bit word that a WordContext holds."""
    return stage_seed(seed, "") ^ stage_seed(0, "")


def map_words(seed: int, seeds: Any, frames: Any) -> tuple[Words, Words]:
    """Compute the random words of a batch of maps.

    ``seed`` is the settings' seed. ``seeds`` and ``frames`` are (B,) integers, arrays or tensors:
    each map's seed and frame number; they wrap at 2^32. Returns (B,) words that change from frame
    to frame, and (B,) words that all frames of a map share.
    """
    xp = of(seeds)
    held = pcg_word(pcg_word(xp.words(seeds)) ^ xp.word(seed_word(seed)))
    return pcg_word(held ^ pcg_word(xp.words(frames))), held


def sample(setting: Distribution, name: str, words: Mapping[str, Words]) -> Image:
    """Sample "stage.parameter" per map, (B,), by words of the scopes "frame" and "held"."""
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
    """Locate a light at (x, y, z), m, that is straight beside, above or below the camera.

    Returns the image axis towards it (-1 for x, -2 for y), the direction on this axis (1 or -1),
    and its distance from the camera, m. Raises ConfigError for a light at another position.
    """
    x, y, z = point_m
    axis, along, across = (-1, x, y) if abs(x) >= abs(y) else (-2, y, x)
    if abs(across) > _MOST_SKEW * abs(along) or abs(z) > _MOST_SKEW:
        raise ConfigError(
            f"an emitter at {tuple(point_m)} m: on tensors it must be straight beside, above or "
            'below the camera: take backend="egl" or "osmesa"'
        )
    return axis, 1 if along > 0 else -1, abs(along)
