"""Matrix products whose rounding is the same on every machine.

NumPy's ``@`` and ``numpy.linalg`` call BLAS. Its rounding depends on the number of threads, the
processor, and the position of a row in the matrix. All products between a seed and a frame are
computed here instead: every product and every sum is rounded by itself, as IEEE 754 says.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array

_Numbers = NDArray[Any]

_FEW = 32  # largest arrays, elements, that NumPy adds up at once; measured
_SHORT = 32  # longest rows, elements, that are faster transposed; measured
_BLOCK = 32_768  # elements of a block, which fits into the cache; measured


def product(left: _Numbers, right: _Numbers) -> _Numbers:
    """Compute (..., K) @ (K, N), or (..., K) @ (K,), adding the terms of each element in order.

    Use it for a few terms (K below 100). For a long row times a vector, multiply and sum instead.
    """
    if right.ndim == 1:
        return product(left, right[:, None])[..., 0]
    if left.ndim == 2 and max(left.size, right.size) <= _FEW and len(right) <= 4:  # poses
        return np.asarray((left[:, :, None] * right).sum(axis=1))
    rows = left.reshape(-1, left.shape[-1])
    # NumPy's loops run along the last axis, which should be long.
    tall = right.shape[1] < min(_SHORT, len(rows))
    first, second = (right.T, rows.T) if tall else (rows, right)
    out = np.empty((len(first), second.shape[1]), np.result_type(first, second))
    step = max(1, _BLOCK // max(1, out.shape[1]))
    for start in range(0, len(out), step):
        part, own = first[start : start + step], out[start : start + step]
        np.multiply(part[:, :1], second[:1], out=own)
        for number in range(1, part.shape[1]):
            own += part[:, number, None] * second[number]
    if tall:
        out = np.ascontiguousarray(out.T)
    return np.asarray(out.reshape(*left.shape[:-1], right.shape[1]))


def norm(vector: _Numbers) -> float:
    """Compute the length of a vector (K,)."""
    return float(np.sqrt((vector * vector).sum()))


def units(vectors: _Numbers) -> _Numbers:
    """Return vectors (..., K) at unit length."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def nearest_rotation(matrix: Array) -> Array:
    """Compute the rotation nearest to a (3, 3) matrix of positive determinant.

    Newton's iteration for the orthogonal factor of the polar decomposition (Higham 1986, SIAM J.
    Sci. Stat. Comput. 7, 1160): the mean of a matrix and its inverse transposed.
    """
    out = matrix / np.abs(matrix).max()
    for _ in range(_ITERATIONS):
        cofactors = np.cross(out[[1, 2, 0]], out[[2, 0, 1]])
        previous, out = out, 0.5 * (out + cofactors / (out[0] * cofactors[0]).sum())
        if np.abs(out - previous).max() < _CONVERGED:
            break
    return np.asarray(out)


#: Each iteration doubles the correct digits: 12 suffice for singular values of 1 to 0.001.
_ITERATIONS, _CONVERGED = 30, 1e-14


def principal_axis(points: _Numbers) -> Array:
    """Compute the unit vector (3,) of largest variance of (N, 3) points; its sign is arbitrary."""
    away = np.ascontiguousarray((points - points.mean(axis=0)).T, np.float64)
    spread = (away[:, None] * away).sum(axis=2)
    for _ in range(_SQUARINGS):
        spread = product(spread, spread)
        spread /= np.trace(spread)
    column = spread[np.argmax(np.diag(spread))]
    return np.asarray(column / norm(column))


#: Ten squarings raise the ratio of two eigenvalues to the power 1,024.
_SQUARINGS = 10


def solve(matrix: Array, right: Array) -> Array:
    """Solve (N, N) @ x = (N, M), diagonally dominant, by Gaussian elimination: x is (N, M)."""
    both = np.concatenate([matrix, right], axis=1)
    for row in range(len(both)):
        both[row] /= both[row, row]
        others = np.arange(len(both)) != row
        both[others] -= both[others, row, None] * both[row]
    return both[:, len(both) :]
