"""Reproducible seeds and random generators, which depend on words and numbers only.

They are the same on every machine, in every process and order of calls. New code uses ``rng_for``;
the other generators stay, because existing data sets depend on them.
"""

from __future__ import annotations

import hashlib
import struct
import zlib

import numpy as np


def stable_seed(*words: object) -> int:
    """Compute a 64-bit seed from words (BLAKE2b)."""
    text = "\x1f".join(str(word) for word in words)
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "little")


def stage_seed(seed: int, stage: str) -> int:
    """Compute a stage's 32-bit seed from a 64-bit seed and the stage's name."""
    return zlib.crc32(struct.pack("<Q", seed), zlib.crc32(stage.encode()))


def rng_for(seed: int, *words: str | int) -> np.random.Generator:
    """Make a random generator from a seed and words (BLAKE2b, then Philox)."""
    text = "\x1f".join([str(int(seed)), *(str(word) for word in words)])
    digest = hashlib.blake2b(text.encode(), digest_size=16).digest()
    return np.random.Generator(np.random.Philox(key=np.frombuffer(digest, "<u8").copy()))


def keyed_rng(seed: int, key: int | str) -> np.random.Generator:
    """Make a random generator from a 64-bit seed and a number or word as key (Philox)."""
    number = zlib.crc32(key.encode()) if isinstance(key, str) else key
    # Explicitly uint64: NumPy converts a list with a number beyond 2**63 to float64.
    return np.random.Generator(np.random.Philox(key=np.array([seed, number], np.uint64)))


def pcg_rng(*words: object) -> np.random.Generator:
    """Make a random generator from words, by ``stable_seed`` (PCG64)."""
    return np.random.default_rng(stable_seed(*words))


def device_key(seed: int, device: int) -> int | None:
    """Compute the seed of a virtual device's properties; None for device 0, the typical device."""
    return stable_seed("device", seed, device) if device else None
