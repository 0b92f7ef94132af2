"""The table styles.toml of hair, beards and glasses, and its hair styles."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from typing import Final, Literal

Comb = Literal["crown", "back", "parting", "curls"]


@dataclass(frozen=True)
class HairStyle:
    """A hair style; lengths in mm on a mean adult head.

    Args:
        women, men: relative frequencies.
        comb: which way strands lie: away from the crown, backwards, away from a parting, or curled.
        top, side, back: thickness of the hair over the skull.
        lock: (shortest, longest) length of the locks that lie on it.
        locks: their number.
        width: of a lock.
        lift: 0 lies flat, 1 stands out.
        fall: 0 holds its direction, 1 hangs down.
        wave: amplitude of waves in a lock.
        relief: height of the ridges between strands.
        parting: side of the parting, mm from the middle.
        fringe: length of hair over the forehead.
        recede: how far the corners of the forehead are bare.
        bald: radius of a bald crown.
        hang: length of the hair that hangs from the sides and the back; 0 for none.
        flare: how far it stands off, mm per mm.
        open_deg: angle from straight ahead to where it begins.
        extra: hair that is tied.
    """

    name: str
    women: float
    men: float
    comb: Comb
    top: float
    side: float
    back: float
    lock: tuple[float, float]
    locks: int
    width: float = 10.0
    lift: float = 0.25
    fall: float = 0.1
    wave: float = 1.0
    relief: float = 2.5
    parting: float = 0.0
    fringe: float = 0.0
    recede: float = 0.0
    bald: float = 0.0
    hang: float = 0.0
    flare: float = 0.0
    open_deg: float = 72.0
    extra: Literal["", "bun", "top bun", "pony tail", "twin tails"] = ""


#: Dimensions of hair, beards and glasses, reflectivities, shares.
STYLE_TABLE: Final = tomllib.loads(files(__package__).joinpath("styles.toml").read_text("utf-8"))
STYLES: Final = tuple(HairStyle(name, **row) for name, row in STYLE_TABLE["hair"].items())
