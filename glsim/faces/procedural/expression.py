"""Expressions of a procedural head: skin pulls, lid motion, and jaw rotation.

Skin pulls are equal for all subjects; lids and jaw depend on the subject's geometry. An expression
is a sum of weighted shapes: a jaw rotation by angle t is linear in (sin t, 1 - cos t), and a lid
closure a is linear in (a, a^2).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ConfigError, did_you_mean
from glsim.core.products import product
from glsim.faces.procedural.lids import lid_closure
from glsim.faces.procedural.model import HeadModel
from glsim.faces.sparse_shapes import SparseShapes

TMJ_MM: Final = (0.0, -1.0, -78.0)  # axis of the temporomandibular joint, in front of the tragus
JAW_LIMIT_DEG: Final = 22.0  # about 45 mm between the incisors; normal maximum 40-55 mm
SIDES: Final = ("L", "R")


def lid_and_jaw_shapes(
    model: HeadModel, neutral: NDArray[np.float64], globes: NDArray[np.float64]
) -> SparseShapes:
    """Build the shapes of lids and jaw of a head, (V, 3) mm, with eyeballs' centres (2, 3) mm."""
    lids = model.lids
    closure = lid_closure(neutral, globes, lids)
    shapes = [
        (f"lid{number}_{side}", lids.index, field * on_side[:, None])
        for number, field in enumerate(closure)
        for side, on_side in zip(SIDES, (lids.left, ~lids.left), strict=True)
    ]
    points = np.flatnonzero(model.jaw)
    weight = model.jaw[points, None]
    away = (neutral - np.asarray(TMJ_MM))[points]
    still = np.zeros(len(points))
    turned = np.stack([still, -away[:, 2], away[:, 1]], axis=1)  # t > 0 lowers the chin
    shapes.append(("jaw_sin", points, weight * turned))
    shapes.append(("jaw_cos", points, -weight * (away * [0.0, 1.0, 1.0])))
    return SparseShapes.join(shapes)


def side_intensities(model: HeadModel, expression: Mapping[str, float]) -> NDArray[np.float64]:
    """Return action units' left and right intensities, (U, 2) in [0, 1]. Raises ConfigError."""
    sides = np.zeros((len(model.units), 2))
    for name, value in expression.items():
        stem, _, side = name.partition("_")
        if stem not in model.units or side not in ("", *SIDES):
            raise ConfigError(f"no action unit {name!r}; {did_you_mean(name, model.units)}")
        for number, letter in enumerate(SIDES):
            if side in ("", letter):
                sides[model.units.index(stem), number] += value
    return np.clip(sides, 0.0, 1.0)


def expression_weights(
    model: HeadModel, expression: Mapping[str, float]
) -> tuple[dict[str, float], dict[str, float]]:
    """Compute nonzero weights of ``model.pulls`` and ``lid_and_jaw_shapes``. Raises ConfigError."""
    sides = side_intensities(model, expression)
    upper, lower = np.clip(product(model.unit_lids.T, sides), -0.5, 2.0)
    upper = np.minimum(upper, 1.0)
    lower = np.minimum(lower, 1.0 + 0.8 * (1.0 - upper))
    opened_deg = float((model.unit_jaw_deg * sides.max(axis=1)).sum())
    turn = np.deg2rad(min(opened_deg, JAW_LIMIT_DEG))
    jaw = {"jaw_sin": float(np.sin(turn)), "jaw_cos": float(1 - np.cos(turn))}
    lids = {
        f"lid{number}_{side}": float(value)
        for number, closed in enumerate((upper, upper**2, lower, lower**2))
        for side, value in zip(SIDES, closed, strict=True)
    }
    pulls = dict(zip(model.pulls.names, sides.ravel().tolist(), strict=True))
    return (
        {name: weight for name, weight in pulls.items() if weight},
        {name: weight for name, weight in (lids | jaw).items() if weight},
    )
