"""The table styles.toml of hair, beards and glasses, and its hair styles."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from typing import Final, Literal

import numpy as np

Comb = Literal["crown", "back", "parting", "curls"]


@dataclass(frozen=True)
class HairStyle:
    """A row of [hair] in styles.toml, where the words are explained; lengths in mm."""

    name: str
    women: float
    men: float
    comb: Comb
    top: float
    side: float
    back: float
    lock: tuple[float, float]
    lift: float = 0.25
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
    strand: float = 1.0
    density: float = 1.0
    stray: float = 1.0


#: Direction of the crown, up and back, from which short hair radiates.
CROWN: Final = np.array([0.0, 0.86, -0.51])
#: Height above the hair of the sheet for the halo of stray hairs, mm: a sixth is left there.
HALO_MM = 11.0
#: The content of styles.toml.
STYLE_TABLE: Final = tomllib.loads(files(__package__).joinpath("styles.toml").read_text("utf-8"))
STYLES: Final = tuple(HairStyle(name, **row) for name, row in STYLE_TABLE["hair"].items())
