"""The model of procedural heads: arrays built by ``tools/heads`` and shipped with the package."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.procedural.lids import Lids
from glsim.faces.sparse_shapes import SparseShapes

#: The baked arrays, beside this file.
HEADS_FILE: Final = "heads.npz"

REGIONS: Final = (
    "skin", "brow", "hair", "lips", "sclera", "iris", "pupil", "ear", "neck", "nose",
    "lids", "forehead", "cheek", "chin", "mouth", "teeth", "shoulder",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class HeadModel:
    """The read-only arrays of all heads: V vertices, F triangles, R regions, U action units.

    Args:
        template_mm: (V, 3) float64, the mean head.
        triangles: (F, 3) int32.
        occluder: (F', 3) int32, the triangles that cast shadows, see ``Mesh``.
        regions: (V,) uint8 indices into REGIONS.
        landmarks: (68,) int64 vertices in the order of ``glsim.faces.regions``.
        identity: a shape per identity parameter, mm per unit of the parameter.
        pulls: two shapes per action unit, the skin pulls of the left and of the right side.
        unit_lids: (U, 2) float64, share by which a unit closes the upper and the lower lid.
        unit_jaw_deg: (U,) float64, rotation by which a unit opens the jaw.
        jaw: (V,) float64 weight of the jaw's rotation in [0, 1].
        anchors_mm: (4, 3) float64, centres of the left and right eye, roots of the left and right
            ear: these parts are rigid.
        rigid: for each anchor, the vertices of the rigid part and their float64 weights.
        cover: (3, V) float64 weights of lips, hair and brows in [0, 1].
    """

    template_mm: NDArray[np.float64]
    triangles: NDArray[np.int32]
    occluder: NDArray[np.int32]
    regions: NDArray[np.uint8]
    landmarks: NDArray[np.int64]
    identity: SparseShapes
    pulls: SparseShapes
    units: tuple[str, ...]
    unit_lids: NDArray[np.float64]
    unit_jaw_deg: NDArray[np.float64]
    jaw: NDArray[np.float64]
    lids: Lids
    anchors_mm: NDArray[np.float64]
    rigid: tuple[tuple[NDArray[np.int64], NDArray[np.float64]], ...]
    cover: NDArray[np.float64]

    def in_regions(self, *names: str) -> NDArray[np.bool_]:
        """Return a mask (V,) of the vertices in the named regions."""
        return np.isin(self.regions, [REGIONS.index(name) for name in names])


#: Arrays whose file holds a narrower type: end of the name -> type in memory.
_NARROW: Final = {"triangles": np.int32, "occluder": np.int32, "points": np.int32}


@lru_cache(maxsize=1)
def head_model() -> HeadModel:
    """Load the model of the shipped file, cached per process."""
    with (files(__package__) / HEADS_FILE).open("rb") as file, np.load(file) as stored:
        arrays: dict[str, Any] = {name: stored[name] for name in stored.files}
    for name, array in arrays.items():
        if (wide := _NARROW.get(name.rpartition("_")[2])) is not None:
            arrays[name] = array.astype(wide)
        arrays[name].setflags(write=False)
    points, weights = arrays["rigid_points"], arrays["rigid_weights"]
    masks = [arrays["rigid_part"] == anchor for anchor in range(4)]
    fields = {name: array for name, array in arrays.items() if name in HeadModel.__annotations__}
    fields |= {name: SparseShapes.of_arrays(arrays, name) for name in ("identity", "pulls")}
    fields["lids"] = Lids(**{name: arrays[f"lids_{name}"] for name in Lids.__annotations__})
    fields["rigid"] = tuple((points[mask], weights[mask]) for mask in masks)
    fields["units"] = tuple(arrays["units"].tolist())
    return HeadModel(**fields)
