"""The garments of the table garments.toml: their dimensions, shares, hems and collars."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources import files
from typing import Final

Profile = Sequence[Sequence[float]]


@dataclass(frozen=True)
class Garment:
    """A garment type; lengths are in mm for a mean adult.

    Args:
        women, men: relative frequencies.
        ease: gap between skin and cloth, where the cloth does not rest on the skin.
        flare: additional gap at the hem.
        hang: 0 for cloth that follows the body, 1 for cloth that falls straight down.
        fold: height of the folds.
        limb: covered share of arms or legs.
        limb_ease, limb_flare: gap around limbs, and additional gap at the cuffs.
        collar: kind of collar, a name in COLLARS or HEMS.
        neckline: height above the base of the neck.
        thick: thickness of cloth and seams.
        gathered: whether hem and cuffs are elastic ribs.
        placket: relief of a strip of buttons or a zip in front; 0 for none.
        tucked: share of people who tuck it into their trousers.
        seen_mm: distance from the edges within which the inner side is visible.
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
    seen_mm: float = 40.0


_TABLE: Final = tomllib.loads(files(__package__).joinpath("garments.toml").read_text("utf-8"))
HEMS: Final[Mapping[str, Profile]] = _TABLE["hems"]
COLLARS: Final[Mapping[str, tuple[Profile, Profile]]] = _TABLE["collars"]
UPPER, LOWER, (SHOES,) = (
    tuple(Garment(name, **row) for name, row in _TABLE[kind].items())
    for kind in ("upper", "lower", "shoes")
)
