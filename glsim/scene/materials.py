"""Albedos of the things in a room at 860 nm, relative to a white wall, and their ranges.

Sources: "rec" is the infrared of 44 real frames of a Kinect V2, as albedo = infrared * d^2 / (30300
* cos(theta) * V), docs/time_of_flight.md, in areas of one material: white walls 0.9 to 1.1, a
painted chair 0.85 to 1.0, the front of a chest 0.65 to 0.8, a floor 0.4 to 0.7, clothes on a hook
0.6 to 0.95, black print 0.04 to 0.2. Green leaves scatter about half of the light in the near
infrared, whose plateau is at 750 to 1300 nm (Jacquemoud and Baret, PROSPECT, 1990). The others are
chosen. Dyes absorb little at 860 nm, so that black cloth is not black.

Surfaces are matte: the light of tof_light has no gloss. Glass and screens return no light to a
camera that does not stand in their mirror direction, so their diffuse albedo is small and they have
no depth, as in real frames.
"""

from __future__ import annotations

import numpy as np

#: material -> lowest and highest albedo.
ALBEDOS = {
    "wall paint": (0.80, 1.00),  # rec, and darker paint (chosen)
    "ceiling paint": (0.90, 1.00),  # rec: white
    "painted wood": (0.75, 1.00),  # rec
    "wood": (0.55, 0.85),  # rec: the chest
    "floor": (0.40, 0.75),  # rec
    "carpet": (0.35, 0.70),  # chosen
    "cloth": (0.45, 0.95),  # rec, and darker (chosen)
    "leather": (0.15, 0.60),  # chosen
    "black plastic": (0.06, 0.25),  # rec: black print
    "lacquer": (0.02, 0.08),  # chosen: dark and glossy, most light leaves in the mirror direction
    "metal": (0.25, 0.60),  # chosen; real ones also have highlights
    "paper": (0.50, 0.95),  # rec: the board's white paper is 0.8 to 1
    "leaves": (0.50, 0.70),  # PROSPECT, rec
    "earth": (0.15, 0.35),  # chosen
    "pot": (0.35, 0.85),  # chosen
    "lamp shade": (0.60, 0.95),  # chosen
    "picture": (0.20, 0.90),  # chosen
    "screen": (0.005, 0.02),  # chosen: no depth beyond half a metre
    "glass": (0.0, 0.01),  # chosen: no depth
}


def draw_albedo(rng: np.random.Generator, material: str) -> float:
    """Draw the albedo of a material."""
    return float(rng.uniform(*ALBEDOS[material]))
