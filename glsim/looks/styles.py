"""The table styles.toml of hair, beards and glasses, and its hair styles."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from typing import Final, Literal

Comb = Literal["crown", "back", "parting", "curls"]


@dataclass(frozen=True)
class HairStyle:
    """A hair style; lengths are in mm for a mean adult's head.

    Args:
        women, men: relative frequencies.
        comb: direction of the strands: from the crown, backwards, from a parting, or curled.
        top, side, back: thickness of the hair above the skull.
        lock: shortest and longest length of lying locks.
        locks: number of lying locks.
        width: width of a lock.
        lift: 0 for flat locks, 1 for locks that stand out.
        fall: 0 for locks that keep their direction, 1 for locks that hang down.
        wave: amplitude of waves in a lock.
        relief: height of the ridges between strands.
        parting: distance of the parting from the middle; its sign gives the side.
        fringe: length of hair over the forehead.
        recede: width of the bare corners of the forehead.
        bald: radius of a bald crown.
        hang: length of hanging hair at the sides and the back; 0 for none.
        flare: distance by which hanging hair stands off, mm per mm of length.
        open_deg: angle from straight ahead at which hanging hair begins.
        extra: kind of tied hair.
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


#: The content of styles.toml.
STYLE_TABLE: Final = tomllib.loads(files(__package__).joinpath("styles.toml").read_text("utf-8"))
STYLES: Final = tuple(HairStyle(name, **row) for name, row in STYLE_TABLE["hair"].items())
