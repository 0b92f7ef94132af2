"""A table of hair styles: their dimensions and shares, chosen from portraits."""

from __future__ import annotations

from dataclasses import dataclass
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


STYLES: Final = (
    HairStyle("shaven", 0.5, 6, "crown", 1.2, 1.0, 1.0, (0, 0), 0, relief=0.5),
    HairStyle("buzz cut", 1, 7, "crown", 4, 2.5, 2.5, (0, 0), 0, relief=1.2),
    HairStyle("crew cut", 2, 9, "crown", 12, 4, 4, (10, 18), 170, 8, 0.5, relief=2.0),
    HairStyle("short", 6, 12, "crown", 18, 9, 10, (18, 34), 230, 9, 0.35),
    HairStyle("short, combed forward", 4, 7, "crown", 17, 8, 10, (22, 40), 240, 9, 0.2, 0.15,
              fringe=26),
    HairStyle("spikes", 2, 3, "curls", 16, 6, 8, (22, 42), 190, 10, 0.9, 0.0, relief=3.5),
    HairStyle("quiff", 3, 6, "back", 30, 7, 8, (30, 55), 220, 11, 0.5, 0.05, relief=3.0),
    HairStyle("side parting", 6, 10, "parting", 24, 12, 12, (34, 60), 240, 11, 0.2, 0.2,
              parting=32),
    HairStyle("slicked back", 3, 5, "back", 14, 9, 10, (50, 80), 200, 11, 0.08, 0.1, relief=2.2),
    HairStyle("undercut", 3, 5, "parting", 26, 3, 3, (40, 66), 150, 12, 0.2, 0.25, parting=-30),
    HairStyle("receding", 2, 9, "back", 11, 7, 9, (16, 30), 190, 9, 0.3, relief=2.2, recede=1),
    HairStyle("balding crown", 2, 9, "crown", 10, 7, 9, (14, 26), 180, 9, 0.3, recede=0.6, bald=52),
    HairStyle("horseshoe", 1, 7, "crown", 7, 8, 10, (14, 26), 170, 9, 0.35, recede=2.2, bald=86),
    HairStyle("mop", 4, 5, "crown", 30, 24, 24, (34, 60), 220, 13, 0.25, 0.3, 2, 3.5, fringe=44),
    HairStyle("wavy, medium", 7, 4, "parting", 24, 20, 22, (60, 110), 150, 15, 0.15, 0.5, 4,
              3.5, 20, hang=115, flare=0.12),
    HairStyle("curly, medium", 6, 4, "curls", 36, 30, 32, (22, 40), 260, 15, 0.5, 0.2, 5, 5.5,
              hang=85, flare=0.15),
    HairStyle("bob", 8, 1, "parting", 20, 18, 22, (70, 120), 130, 15, 0.06, 0.7, 1, 2.8, 14,
              hang=120, flare=0.1),
    HairStyle("bob with fringe", 5, 0.5, "parting", 20, 18, 22, (70, 110), 140, 14, 0.06, 0.7,
              1, 2.8, 0, 56, hang=118, flare=0.1),
    HairStyle("long, straight", 11, 1.5, "parting", 15, 12, 16, (90, 170), 120, 16, 0.05, 0.8,
              1, 2.8, hang=250, flare=0.04),
    HairStyle("long, side parting", 7, 1, "parting", 18, 14, 18, (90, 160), 130, 16, 0.06,
              0.75, 2, 3, 34, hang=230, flare=0.06),
    HairStyle("long, wavy", 9, 2, "parting", 22, 20, 22, (80, 150), 140, 16, 0.1, 0.7, 6, 4.0,
              10, hang=230, flare=0.12, open_deg=68),
    HairStyle("long, curly", 5, 1, "curls", 36, 36, 38, (24, 44), 280, 17, 0.5, 0.3, 6, 6.0,
              hang=190, flare=0.2, open_deg=66),
    HairStyle("afro", 3, 3, "curls", 60, 52, 54, (8, 14), 240, 13, 0.9, 0.0, 2, 6.5),
    HairStyle("short afro", 2, 4, "curls", 20, 14, 14, (5, 9), 200, 9, 0.9, 0.0, 1, 3.6),
    HairStyle("bun", 5, 1, "back", 10, 8, 9, (30, 60), 120, 12, 0.03, 0.0, 1, 2.4, extra="bun"),
    HairStyle("top bun", 2, 3, "back", 9, 7, 8, (30, 50), 110, 12, 0.03, 0.0, 1, 2.4,
              extra="top bun"),
    HairStyle("pony tail", 7, 2, "back", 11, 8, 10, (30, 60), 120, 12, 0.04, 0.0, 1, 2.4,
              extra="pony tail"),
    HairStyle("twin tails", 2, 0, "parting", 12, 9, 11, (30, 60), 110, 12, 0.04, 0.1, 1, 2.4,
              extra="twin tails"),
)  # fmt: skip
