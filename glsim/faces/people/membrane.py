"""Replace small parts of a mesh by a membrane stretched over their border, as a linear map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.faces.people.subdivision import LinearMap
from glsim.geometry.products import solve


def membrane(quads: NDArray[np.int64], inside: NDArray[np.bool_]) -> LinearMap:
    """Return the map that puts each inner vertex at the mean of its neighbours; others stay.

    Args:
        quads: (Q, 4).
        inside: (V,), a few hundred vertices at most: the equations are dense.
    """
    size = len(inside)
    inner = np.flatnonzero(inside)
    outer = np.flatnonzero(~inside)
    pairs = np.concatenate([np.stack([quads, np.roll(quads, by, axis=1)], axis=2) for by in (1, 3)])
    pairs = np.unique(pairs.reshape(-1, 2), axis=0)
    pairs = pairs[inside[pairs[:, 0]]]
    number = np.full(size, -1)
    number[inner] = np.arange(len(inner))
    among = np.zeros((len(inner), len(inner)))
    border, of_border = np.unique(pairs[~inside[pairs[:, 1]], 1], return_inverse=True)
    from_border = np.zeros((len(inner), len(border)))
    both = inside[pairs[:, 1]]
    np.fill_diagonal(among, np.bincount(number[pairs[:, 0]], minlength=len(inner)))
    among[number[pairs[both, 0]], number[pairs[both, 1]]] = -1.0
    from_border[number[pairs[~both, 0]], of_border] = 1.0
    weights = solve(among, from_border)
    row, column = np.nonzero(weights > 1e-6)
    return LinearMap(
        np.concatenate([outer, inner[row]]),
        np.concatenate([outer, border[column]]),
        np.concatenate([np.ones(len(outer)), weights[row, column]]),
        size,
    )
