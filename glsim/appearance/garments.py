"""Garments as numbers. All are chosen, on photographs of clothes; a subject's own values vary."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

Collar = Literal["crew", "v", "shirt", "polo", "roll", "hood", "zip", "none"]


@dataclass(frozen=True)
class Garment:
    """One garment for the upper body; lengths in mm on a mean adult.

    Args:
        weight: relative frequency.
        ease: room between skin and cloth where it does not rest.
        flare: further room at the hem.
        slope: mm per mm by which cloth comes back to the body below what it falls from.
        fold: height of the folds.
        sleeve: covered share of the arm.
        sleeve_ease: room in the sleeve.
        collar: its kind.
        neckline: height over the base of the neck.
        thick: thickness of cloth and seams.
        gathered: whether hem and cuffs are ribs that hold the cloth.
        placket: height of a strip of buttons or a zip in front; 0 for none.
        tucked: share of people who wear it in their trousers.
    """

    name: str
    weight: float
    ease: float
    flare: float
    slope: float
    fold: float
    sleeve: float
    sleeve_ease: float
    collar: Collar = "crew"
    neckline: float = 4.0
    thick: float = 2.0
    gathered: bool = False
    placket: float = 0.0
    tucked: float = 0.0


GARMENTS: Final = (
    Garment("T-shirt", 6, 8, 16, 0.12, 12, 0.36, 12, neckline=-4, tucked=0.15),
    Garment("T-shirt, V-neck", 2, 7, 14, 0.16, 11, 0.34, 11, "v", -2, tucked=0.1),
    Garment("long-sleeved shirt", 3, 7, 12, 0.16, 11, 0.95, 10, neckline=-2, tucked=0.1),
    Garment("shirt", 5, 11, 20, 0.12, 15, 0.95, 16, "shirt", 2, 2.0, False, 2.5, 0.45),
    Garment("polo shirt", 2, 9, 16, 0.12, 12, 0.38, 12, "polo", 2, 2.5, False, 2.5, 0.25),
    Garment("sweater", 4, 15, 16, 0.1, 15, 0.96, 18, neckline=2, thick=5.0, gathered=True),
    Garment("turtleneck", 2, 9, 8, 0.2, 9, 0.96, 11, "roll", 4, 4.0, True),
    Garment("jacket", 3, 22, 22, 0.06, 17, 0.97, 24, "zip", 4, 5.0, True, 4.0),
    Garment("hooded sweater", 3, 18, 20, 0.07, 16, 0.96, 21, "hood", 2, 5.0, True),
    Garment("tank top", 1, 7, 18, 0.1, 10, 0.03, 2, "none", -34, 3.0, tucked=0.1),
)


@dataclass(frozen=True)
class Lower:
    """One garment for the lower body; lengths in mm on a mean adult.

    Args:
        women, men: relative frequencies.
        length: covered share of the leg.
        ease: room at the top of the leg.
        flare: further room at the hem.
        slope: mm per mm by which cloth comes back to the leg; below 0 for skirts, which widen.
        fold: height of the folds.
        skirt: whether one tube goes round both legs.
    """

    name: str
    women: float
    men: float
    length: float
    ease: float
    flare: float
    slope: float
    fold: float
    skirt: bool = False


LOWERS: Final = (
    Lower("trousers", 4, 6, 0.97, 9, 10, 0.04, 7),
    Lower("slim trousers", 5, 4, 0.95, 4, 3, 0.1, 4),
    Lower("wide trousers", 3, 3, 0.985, 14, 26, 0.0, 10),
    Lower("joggers", 2, 3, 0.93, 13, 2, 0.05, 9),
    Lower("shorts", 1.5, 3, 0.42, 10, 10, 0.0, 7),
    Lower("skirt", 2, 0, 0.46, 12, 0, -0.1, 12, True),
    Lower("pencil skirt", 1, 0, 0.48, 9, 0, 0.03, 4, True),
    Lower("long skirt", 1.5, 0, 0.86, 12, 0, -0.1, 14, True),
)
