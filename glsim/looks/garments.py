"""A table of garment types: their dimensions and shares, chosen from photographs of clothes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

Profile = tuple[tuple[float, float, float], ...]

#: Profiles of edges: rows of (mm away from the cloth, off it in its thicknesses, and in mm). They
#: end inside the cloth, so that its thickness shows. "crew" and "v" are ribs round the neck.
HEMS: Final[dict[str, Profile]] = {
    "hem": ((0.0, 0.6, 0), (0.5, -0.9, 0), (0, -1.2, -0.8), (-14, -1.3, -1.2)),
    "rib": ((0.5, 0.5, 1), (2, 0.6, 1.2), (12, 0.6, 1.2), (23, 0.5, 1), (24, 0, 0), (23, -0.8, 0),
            (-6, -1, -1)),
    "crew": ((0.5, 0.5, 1), (2, 0.6, 1.2), (8, 0.6, 1.2), (16, 0.5, 1), (17, 0, 0), (16, -0.8, 0),
             (-6, -1, -1)),
    "v": ((0.5, 0.5, 1), (2, 0.6, 1.2), (6, 0.6, 1.2), (11, 0.5, 1), (12, 0, 0), (11, -0.8, 0),
          (-6, -1, -1)),
    "waist": ((0.5, 0.5, 1), (2, 0.6, 1.2), (13, 0.6, 1.2), (25, 0.5, 1), (26, 0, 0), (25, -0.8, 0),
              (-6, -1, -1)),
}  # fmt: skip
_ROLL: Final = ((0, 0), (-2, 10), (-8, 24), (-12, 38), (-11, 46), (-6, 49), (-1, 44), (2, 30),
                (3, 12), (1, 6), (-3, 6))  # fmt: skip
_STAND: Final = ((0, 0), (1, 10), (-1, 22), (-2, 31), (1, 35), (5, 33), (9, 24), (15, 6), (21, -10),
                 (20, -13), (15, -9))  # fmt: skip
#: Profiles of collars in front and behind: rows of (outward from the neck, up along it) mm.
COLLARS: Final = {
    "shirt": (_STAND, _STAND),
    "roll": (_ROLL, _ROLL),
    "zip": (((0, 0), (4, 5), (6, 10), (6, 14), (5, 16), (2, 16), (0, 14), (0, 9), (0, 3)),
            ((0, 0), (5, 10), (8, 26), (8, 42), (6, 47), (2, 48), (-1, 44), (0, 26), (0, 6))),
    "hood": (((0, 0), (2, 6), (5, 14), (10, 18), (16, 17), (21, 10), (23, 0), (22, -4), (19, -5),
              (15, -4)),
             ((0, 0), (3, 12), (10, 27), (24, 36), (42, 32), (54, 16), (58, -8), (52, -36),
              (40, -54), (30, -54))),
}  # fmt: skip


@dataclass(frozen=True)
class Garment:
    """A garment type; lengths in mm on a mean adult.

    Args:
        women, men: relative frequencies.
        ease: room between skin and cloth where it does not rest.
        flare: further room at the hem.
        hang: 0 for cloth that follows the body, 1 for cloth that falls straight.
        fold: height of the folds.
        limb: covered share of arms or legs.
        limb_ease, limb_flare: room around limbs, and further room at the cuffs.
        collar: its kind, of COLLARS or HEMS.
        neckline: height over the base of the neck.
        thick: thickness of cloth and seams.
        gathered: whether hem and cuffs are ribs that hold the cloth.
        placket: height of a strip of buttons or a zip in front; 0 for none.
        tucked: share of people who wear it in their trousers.
        seen_rings: rings of triangles from its edges in which one can look into it.
    """

    name: str
    women: float
    men: float
    ease: float
    flare: float
    hang: float
    fold: float
    limb: float
    limb_ease: float
    limb_flare: float
    collar: str = "crew"
    neckline: float = 4.0
    thick: float = 2.0
    gathered: bool = False
    placket: float = 0.0
    tucked: float = 0.0
    seen_rings: int = 3


UPPER: Final = (
    Garment("T-shirt", 6, 6, 8, 16, 0.8, 12, 0.36, 12, 4, neckline=-4, tucked=0.15),
    Garment("T-shirt, V-neck", 2, 2, 7, 14, 0.7, 11, 0.34, 11, 4, "v", -2, tucked=0.1),
    Garment("long-sleeved shirt", 3, 3, 7, 12, 0.7, 11, 0.95, 10, -4.5, neckline=-2, tucked=0.1),
    Garment("shirt", 5, 5, 11, 20, 0.8, 15, 0.95, 16, -7, "shirt", 2, 2, False, 2.5, 0.45),
    Garment("polo shirt", 2, 2, 9, 16, 0.8, 12, 0.38, 12, 4, "shirt", 2, 2.5, False, 2.5, 0.25),
    Garment("sweater", 4, 4, 15, 6, 0.9, 15, 0.96, 18, -8, neckline=2, thick=5, gathered=True),
    Garment("turtleneck", 2, 2, 9, 8, 0.5, 9, 0.96, 11, -5, "roll", 4, 4, True),
    Garment("jacket", 3, 3, 20, 8, 1.0, 17, 0.97, 24, -11, "zip", 4, 5, True, 4),
    Garment("hooded sweater", 3, 3, 16, 8, 1.0, 16, 0.96, 21, -9, "hood", 2, 5, True),
)
LOWER: Final = (
    Garment("trousers", 4, 6, 2, 3, 0.5, 7, 0.97, 9, 10, "waist"),
    Garment("slim trousers", 5, 4, 2, 3, 0.2, 4, 0.95, 4, 3, "waist"),
    Garment("wide trousers", 3, 3, 2, 3, 0.9, 10, 0.985, 14, 26, "waist"),
    Garment("joggers", 2, 3, 2, 3, 0.6, 9, 0.93, 13, 2, "waist", gathered=True),
    Garment("shorts", 1.5, 3, 2, 3, 0.9, 7, 0.42, 10, 10, "waist", seen_rings=11),
)
SHOES: Final = Garment("shoes", 1, 1, 7, 0, 0.3, 1, 1, 7, 0, "rib", 0, 3, seen_rings=0)
