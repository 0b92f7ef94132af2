"""Which way strands of hair lie, and coordinates that follow them."""

from __future__ import annotations

import numpy as np

from glsim.core.products import product
from glsim.looks.anatomy import Anatomy, Array
from glsim.looks.styles import Comb as CombName

#: Relief is drawn out along strands by this factor; chosen.
_ALONG = 0.16
#: Radius of a mean skull, mm, for angles as lengths.
_SKULL_MM = 90.0
#: The crown, from which short hair radiates, as a direction: up and back.
_CROWN = np.array([0.0, 0.86, -0.51])


class Comb:
    """A field of directions over the head of a style."""

    def __init__(self, name: CombName, anatomy: Anatomy, parting_mm: float) -> None:
        """parting_mm: of the parting beside the middle, at the scale of a mean head."""
        self._name = name
        self._centre = anatomy.centre
        self._parting = parting_mm * anatomy.scale

    def directions(self, points: Array) -> Array:
        """Return (N, 3) unit directions along the strands at (N, 3) points, along the skull."""
        out = points - self._centre
        out = out / np.linalg.norm(out, axis=1, keepdims=True)
        wanted = np.zeros_like(out)
        if self._name == "crown":
            wanted[:] = out - _CROWN
        elif self._name == "back":
            wanted[:] = (0.0, -0.25, -1.0)
        elif self._name == "parting":
            beside = points[:, 0] - self._centre[0] - self._parting * np.clip(out[:, 1], 0, 1)
            side = np.tanh(beside / 6.0)
            wanted[:, 0] = side * np.clip(out[:, 1] + 0.2, 0, 1)
            wanted[:, 1] = -np.clip(1.0 - out[:, 1], 0.15, 1)
            wanted[:, 2] = -0.25 * np.clip(out[:, 1], 0, 1) - 0.6 * np.clip(out[:, 2], 0, 1)
        else:
            wanted[:] = out
            wanted[:, 1] -= 0.3
            return np.asarray(wanted / np.linalg.norm(wanted, axis=1, keepdims=True))
        wanted -= (wanted * out).sum(axis=1, keepdims=True) * out
        length = np.linalg.norm(wanted, axis=1, keepdims=True)
        return np.asarray(wanted / np.maximum(length, 0.05))

    def strand_coordinates(self, points: Array) -> Array:
        """Return (N, 3) mm in which strands are long along one axis and apart along the others."""
        out = points - self._centre
        length = np.linalg.norm(out, axis=1)
        if self._name == "curls":
            return np.asarray(out)
        if self._name == "crown":
            beside = np.cross(_CROWN, [1.0, 0.0, 0.0])
            angle = np.arctan2(product(out, beside), out[:, 0])
            polar = np.arccos(np.clip(product(out, _CROWN) / length, -1, 1)) * _SKULL_MM
            ring = np.maximum(np.sin(polar / _SKULL_MM), 0.25) * _SKULL_MM
            columns = (ring * np.cos(angle), ring * np.sin(angle), _ALONG * polar)
        elif self._name == "back":
            angle = np.arctan2(out[:, 0], out[:, 1] + 40.0)
            columns = (angle * _SKULL_MM, _ALONG * out[:, 2], 0.0 * length)
        else:
            angle = np.arctan2(out[:, 0] - self._parting, out[:, 1] + 40.0)
            columns = (out[:, 2], _ALONG * angle * _SKULL_MM, 60.0 * np.sign(angle))
        return np.stack(columns, axis=1)
