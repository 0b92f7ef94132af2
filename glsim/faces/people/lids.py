"""How far the action that closes an eye moves each point, so that the lids meet and do not cross.

The data's action is that of the base mesh, whose eyes are wide: at full strength the upper lid of
the mean person would end 4 mm below the lower one, of other people more on one side of the eye.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.action_units import shape_weights
from glsim.faces.people.landmarks import landmark_vertices
from glsim.faces.people.model import BodyModel

#: Action -> the landmarks of the upper lid of its eye in the order of their x, and those of the
#: lower lid below them.
_LIDS: Final = {"eyeBlinkRight": ((37, 38), (41, 40)), "eyeBlinkLeft": ((43, 44), (47, 46))}
#: How far the closed upper lid ends below the edge of the lower one, mm: no gap, as of embedded
#: heads. Chosen.
_OVERLAP_MM: Final = 0.25


@dataclass(frozen=True, eq=False)
class _Closing:
    """The action that closes one eye.

    Args:
        points, offsets_mm: (P,) vertices and (P, 3) their whole way.
        upper, lower: (2,) vertices on the edges of the lids, one below the other.
        way_mm: (2,) how much nearer the action brings them.
    """

    points: NDArray[np.int32]
    offsets_mm: NDArray[np.float32]
    upper: NDArray[np.int64]
    lower: NDArray[np.int64]
    way_mm: NDArray[np.float64]


class Lids:
    """The lids of a model.

    Attributes:
        actions: those that close an eye.
    """

    actions: Final = tuple(_LIDS)

    def __init__(self, model: BodyModel) -> None:
        landmarks = landmark_vertices(model)
        self._closing = {}
        for action, (upper, lower) in _LIDS.items():
            points, offsets = model.actions.shape(action)
            above, below = landmarks[list(upper)], landmarks[list(lower)]
            moved = np.zeros((len(model.regions), 3))
            moved[points] = offsets
            way = moved[below, 1] - moved[above, 1]
            self._closing[action] = _Closing(points, offsets, above, below, way)

    def close(self, points_mm: NDArray[np.floating[Any]], weights: Mapping[str, float]) -> None:
        """Close the eyes of (V, 3) points of a person at rest, in place; at weight 1 lids meet.

        Call it behind all other actions: what they open or close counts.

        Args:
            weights: action -> weight; those that close no eye are left out.
        """
        for action, eye in self._closing.items():
            if action not in weights:
                continue
            open_mm = points_mm[eye.upper, 1] - points_mm[eye.lower, 1]
            share = np.clip((open_mm + _OVERLAP_MM) / eye.way_mm, 0.0, 1.0)
            across = np.interp(points_mm[eye.points, 0], points_mm[eye.upper, 0], share)
            moved = (weights[action] * across)[:, None] * eye.offsets_mm
            points_mm[eye.points] += moved.astype(points_mm.dtype)


@lru_cache(maxsize=1)
def lids_of(model: BodyModel) -> Lids:
    """Return the lids of a model; made once."""
    return Lids(model)


def add_expression(
    model: BodyModel, rest_mm: NDArray[np.float32], expression: Mapping[str, float]
) -> None:
    """Move (V, 3) points of a person at rest by action units -> intensities, in place."""
    weights, lids = shape_weights(expression), lids_of(model)
    model.actions.add(rest_mm, {n: w for n, w in weights.items() if n not in lids.actions})
    lids.close(rest_mm, weights)
