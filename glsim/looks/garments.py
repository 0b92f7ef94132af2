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
    """A garment of garments.toml, which explains the fields; lengths in mm for a mean adult."""

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
