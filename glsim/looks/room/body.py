"""Where the floor and the seat of a whole person are, in the frame of its mesh."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from glsim.faces.base import Face

#: A mesh that reaches this far below its origin, mm, has a body: heads and busts end above, and the
#: origin of a sitting child of four years is higher (chosen).
_BODY_MM = 550.0
#: The floor and the seat are rounded to this, mm, so that a breath does not build another room.
_STEP_MM = 4.0


class Body(NamedTuple):
    """The place of a whole person in a room; canonical mm.

    Args:
        floor_mm: y of the floor.
        seat_mm: y of the seat and z of its back; None if the person stands.
    """

    floor_mm: float
    seat_mm: tuple[float, float] | None = None


def body_of(face: Face) -> Body | None:
    """Return the floor and the seat below a face, or None for a head without a body.

    ``Face.notes`` may hold "floor_mm" and "sitting"; otherwise the lowest vertex stands on the
    floor.
    """
    y = face.mesh.vertices_mm[:, 1]
    lowest = float(y.min())
    noted = face.notes.get("floor_mm")
    if not isinstance(noted, int | float) and not lowest <= -_BODY_MM:  # NaN: no body
        return None
    floor = float(noted) if isinstance(noted, int | float) else lowest
    floor = round(floor / _STEP_MM) * _STEP_MM
    return Body(floor, _seat(face, floor) if face.notes.get("sitting") else None)


def _seat(face: Face, floor_mm: float) -> tuple[float, float] | None:
    """The underside of the hips and the back of the trunk; shares of the height are chosen."""
    x, y, z = face.mesh.vertices_mm.T
    height = (y - floor_mm) / -floor_mm
    trunk = (np.abs(x) < 110) & (height > 0.55) & (height < 0.85)
    if not trunk.any():
        return None
    back = float(np.percentile(z[trunk], 2))
    hips = (np.abs(x) < 160) & (z > back) & (z < back + 250) & (height > 0.2) & (height < 0.6)
    if not hips.any():
        return None
    seat = float(y[hips].min())
    return round(seat / _STEP_MM) * _STEP_MM, round(back / _STEP_MM) * _STEP_MM
