"""Perlin and simplex noise: range, variance, correlation, continuity, and change with time."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.noise.numpy_twins import values as fields
from tests.support.stage_harness import (
    WHOLE,
    Z_MAX,
    Image,
    flat,
    frame,
    run_twin,
    z_correlation,
    z_mean,
)

Field = Callable[[fields.Vector, int], Image]

FIELDS = {"perlin": fields.perlin_at, "simplex": fields.simplex_at}
COUNT = 200_000

#: The 16 gradients and their second moments; 12 edges of a cube, 4 of them twice.
GRADIENTS = np.array(
    [[1, 1, 0], [-1, 1, 0], [1, -1, 0], [-1, -1, 0], [1, 0, 1], [-1, 0, 1], [1, 0, -1],
     [-1, 0, -1], [0, 1, 1], [0, -1, 1], [0, 1, -1], [0, -1, -1], [1, 1, 0], [0, -1, 1],
     [-1, 1, 0], [0, -1, -1]]
)  # fmt: skip
MOMENTS = GRADIENTS.T @ GRADIENTS / 16


@pytest.fixture(params=FIELDS, name="field")
def _field(request: pytest.FixtureRequest) -> Field:
    return FIELDS[str(request.param)]


def points(seed: int = 0, count: int = COUNT) -> fields.Vector:
    """Random points, so far apart that hardly two share a cell."""
    x, y, z = np.random.default_rng(seed).uniform(-300, 300, (3, count)).astype(np.float32)
    return x, y, z


def moved(at: fields.Vector, by: NDArray[np.floating] | list[float]) -> fields.Vector:
    x, y, z = (part + np.float32(step) for part, step in zip(at, by, strict=True))
    return x, y, z


def field_of(values: Image) -> NDArray[np.float64]:
    """The field that moved the depth of a plane at 1 m by at most 100 mm."""
    return (values.astype(np.float64) - 1.0) * 10.0


def test_range_and_mean(field: Field) -> None:
    values = field(points(), 1)
    assert 0.8 < np.abs(values).max() <= 1.0
    assert abs(z_mean(values)) < Z_MAX
    assert abs(z_mean(values**3)) < Z_MAX  # symmetric about 0


def test_variance_of_perlin() -> None:
    """The expected square of the sum over corners, integrated over a cell by Gauss's rule."""
    nodes, weights = np.polynomial.legendre.leggauss(12)
    f, weights = (nodes + 1) / 2, weights / 2
    fade = f**3 * (f * (f * 6 - 15) + 10)
    cell = np.stack(np.meshgrid(f, f, f, indexing="ij"), axis=-1)
    share = np.stack(np.meshgrid(fade, fade, fade, indexing="ij"), axis=-1)
    variance = np.zeros(cell.shape[:3])
    for corner in np.ndindex(2, 2, 2):
        offset = cell - corner
        weight = np.where(corner, share, 1 - share).prod(axis=-1)
        variance += weight**2 * np.einsum("...i,ij,...j", offset, MOMENTS, offset)
    expected = np.einsum("i,j,k,ijk", weights, weights, weights, variance)
    assert abs(z_mean(fields.perlin_at(points(), 1).astype(np.float64) ** 2, expected)) < Z_MAX


def test_variance_of_simplex() -> None:
    """Two nodes per unit of volume; their kernels' balls are integrated one by one."""
    r = (np.arange(2000) + 0.5) / 2000 * np.sqrt(0.5)
    kernel = (76.0 * (0.5 - r**2) ** 4) ** 2 * r**2 * np.trace(MOMENTS) / 3
    expected = 2 * (kernel * 4 * np.pi * r**2).sum() * (r[1] - r[0])
    assert abs(z_mean(fields.simplex_at(points(), 1).astype(np.float64) ** 2, expected)) < Z_MAX


@pytest.mark.parametrize("other", [0, 2, 3, 1 + 2**16])
def test_seeds_are_independent(field: Field, other: int) -> None:
    """Octaves take consecutive seeds, so these matter most."""
    assert abs(z_correlation(field(points(), 1), field(points(), other))) < Z_MAX


def test_continuous(field: Field) -> None:
    """No steps along any axis: the change is bounded by slope times distance."""
    at, step = points(), 1e-3
    for axis in np.eye(3):
        change = np.abs(field(moved(at, step * axis), 1) - field(at, 1))
        assert change.max() < 8.0 * step + 1e-4  # float32 coordinates are 3e-5 apart here


def sequence(use: str, seed: int, time_s: float, drift_hz: float) -> NDArray[np.float64]:
    """The field of a frame of a sequence, by the frame's seed and time."""
    p = {"lattice_x_px": 8.0, "lattice_y_px": 8.0} if use == "perlin" else {"lattice_px": 8.0}
    at = frame(seed, time_s=time_s)
    return field_of(run_twin(use, flat(1.0), at, amplitude_mm=100, drift_hz=drift_hz, **p)["depth"])


@pytest.mark.parametrize("use", FIELDS)
def test_without_drift_frames_are_independent(use: str) -> None:
    first, second = sequence(use, 0, 0.0, 0.0), sequence(use, 1, 1 / 30, 0.0)
    cells = WHOLE.width * WHOLE.height / 8**2
    assert abs(np.corrcoef(first.ravel(), second.ravel())[0, 1]) * np.sqrt(cells) < Z_MAX
    np.testing.assert_array_equal(first, sequence(use, 0, 9.9, 0.0))


@pytest.mark.parametrize("use", FIELDS)
def test_with_drift_the_field_moves_on(use: str) -> None:
    frames = [sequence(use, seed, seed / 30, 0.5) for seed in range(4)]
    for before, after in pairwise(frames):
        assert 0.0 < np.abs(after - before).max() < 8.0 * 0.5 / 30
        assert np.corrcoef(before.ravel(), after.ravel())[0, 1] > 0.98
    later = sequence(use, 300, 10.0, 0.5)
    cells = WHOLE.width * WHOLE.height / 8**2
    assert abs(np.corrcoef(frames[0].ravel(), later.ravel())[0, 1]) * np.sqrt(cells) < Z_MAX
