"""The source ``clay``: balls of clay."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

import numpy as np
from pydantic import Field

import glsim


class ClaySettings(glsim.FaceSettings):
    """Balls of clay, each of another size."""

    endless: ClassVar[bool] = True

    radius_mm: float = Field(80.0, ge=20, le=150, description="mean radius of the balls")

    def open(self, seed: int) -> Clay:
        return Clay(seed, self.radius_mm)


class Clay(glsim.FaceSource):
    name = "clay"

    def __init__(self, seed: int, radius_mm: float) -> None:
        self._seed, self._radius_mm = seed, radius_mm

    def subjects(self, count: int | None) -> list[str]:
        return [f"c{number}" for number in range(count or 1)]

    def frames(self, subject: str, count: int | None) -> list[glsim.FaceKey]:
        return [glsim.FaceKey(subject, "main", number) for number in range(count or 1)]

    def load(self, keys: Sequence[glsim.FaceKey]) -> Iterator[glsim.Face]:
        for key in keys:
            rng = np.random.default_rng([self._seed, *key.subject.encode()])
            yield glsim.Face(key, _ball(self._radius_mm * rng.uniform(0.9, 1.1)))


def _ball(radius_mm: float, rings: int = 24, spokes: int = 48) -> glsim.Mesh:
    latitude = np.linspace(0, np.pi, rings + 1)[:, None]
    longitude = 2 * np.pi * np.arange(spokes)[None] / spokes
    points = np.stack(
        [
            np.sin(latitude) * np.cos(longitude),
            np.cos(latitude) + 0 * longitude,
            np.sin(latitude) * np.sin(longitude),
        ],
        axis=-1,
    ).reshape(-1, 3)
    row, column = np.mgrid[:rings, :spokes]
    after = (column + 1) % spokes
    a, b = row * spokes + column, row * spokes + after
    c, d = a + spokes, b + spokes
    corners = np.stack([a, b, c, b, d, c], axis=-1).reshape(-1, 3)
    return glsim.Mesh((radius_mm * points).astype(np.float32), corners.astype(np.int32))
