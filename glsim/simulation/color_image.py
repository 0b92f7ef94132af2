"""Colour images of scenes: reflectance of each region under a lamp and ambient light, 8-bit sRGB.

The renderer's albedo is a single number, for infrared light. Each region has a colour, which turns
it into red, green and blue. The colours look plausible but are not measured. No shadows are cast.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array
from glsim.core.mesh import SKIN_ALBEDO
from glsim.core.products import norm, product
from glsim.core.seeds import rng_for
from glsim.noise.frame_context import Layers
from glsim.settings.distribution import ScopeSeeds

_Color = tuple[float, float, float]
#: Linear reflectance (red, green, blue) of the darkest and the palest skin; a subject's skin lies
#: between them. The values were chosen, not measured.
_SKIN: Final[tuple[_Color, _Color]] = ((0.10, 0.055, 0.04), (0.72, 0.50, 0.40))
_HAIR: Final[tuple[_Color, _Color]] = ((0.012, 0.010, 0.009), (0.42, 0.29, 0.15))
#: Linear colour of a region relative to its albedo; of parts of the skin relative to it. Chosen.
_OF_SKIN: Final[Mapping[str, _Color]] = {
    "lips": (0.95, 0.55, 0.55), "mouth": (0.5, 0.15, 0.15), "mouth socket": (0.5, 0.15, 0.15),
    "gums": (0.8, 0.35, 0.35), "ear": (1.0, 0.92, 0.9), "nose": (1.0, 0.95, 0.93),
}  # fmt: skip
_PLAIN: Final[Mapping[str, _Color]] = {
    "sclera": (0.8, 0.78, 0.75), "pupil": (0.01, 0.01, 0.01), "teeth": (0.75, 0.7, 0.6),
    "glasses": (0.05, 0.05, 0.06), "screen": (0.03, 0.03, 0.04), "plant": (0.10, 0.28, 0.06),
    "window": (0.75, 0.85, 0.95), "floor": (0.45, 0.33, 0.22), "wall": (0.85, 0.83, 0.78),
    "ceiling": (0.9, 0.9, 0.88), "door": (0.75, 0.68, 0.58), "furniture": (0.55, 0.43, 0.32),
}  # fmt: skip
_HAIRY: Final = ("hair", "beard", "brow", "scalp")
#: _AMBIENT: share of ambient light, which is stronger from above. _MEAN: mean brightness to which
#: the camera exposes; white is 1. The values were chosen, not measured.
_AMBIENT, _MEAN = 0.45, 0.22


def color_image(layers: Layers, numbers: Mapping[str, int], seeds: ScopeSeeds) -> NDArray[np.uint8]:
    """Return an (h, w, 3) uint8 sRGB image, red first; 0 where there is no surface.

    Layers are clean, (h, w) metres; normal, (h, w, 4) unit vectors in the camera frame and albedo;
    and optionally region, (h, w) numbers as in ``numbers``. A surface without a region has the
    colour of skin. The subject's seed decides colours, the sequence's seed the lamp.
    """
    seen, normal = layers["clean"] > 0, layers["normal"]
    region = layers.get("region")
    colors = _palette(numbers, seeds)
    palette = np.array([colors.get(number, colors[0]) for number in range(256)])
    codes = np.zeros(seen.shape, np.uint8) if region is None else region.astype(np.uint8)
    lamp = rng_for(seeds.sequence, "lamp")
    away = np.array([lamp.uniform(-1, 1), -lamp.uniform(0.3, 1.2), -1.0])  # y is down, z away
    direct = np.clip(product(normal[..., :3], away / norm(away)), 0, None)
    around = 0.75 - 0.25 * normal[..., 1]
    light = _AMBIENT * around + (1 - _AMBIENT) * direct
    bright = palette[codes] * (light * normal[..., 3] / SKIN_ALBEDO)[..., None]
    mean = bright[seen].mean() if seen.any() else 1.0
    cut = np.clip(np.where(seen[..., None], bright * (_MEAN / mean), 0), 0, 1)
    # The transfer curve of sRGB (IEC 61966-2-1).
    srgb = np.where(cut <= 0.0031308, 12.92 * cut, 1.055 * cut ** (1 / 2.4) - 0.055)
    return np.asarray(np.rint(255 * srgb).astype(np.uint8))


def _palette(numbers: Mapping[str, int], seeds: ScopeSeeds) -> dict[int, Array]:
    """Return the linear colour of each region, number -> colour; number 0 is skin."""
    person = rng_for(seeds.subject, "colours")
    skin = _between(_SKIN, person.uniform())
    hair = _between(_HAIR, person.uniform() ** 2)
    iris = _between(((0.08, 0.04, 0.02), (0.25, 0.35, 0.45)), person.uniform())
    cloth = person.uniform(0.05, 0.8, 3)
    colors = {0: skin}
    for name, number in numbers.items():
        color = skin * _OF_SKIN.get(name, (1, 1, 1))
        if name in _PLAIN:
            color = np.array(_PLAIN[name])
        elif name in _HAIRY:
            color = hair
        elif name in ("cloth", "person", "foot"):
            color = cloth if name == "cloth" else cloth[::-1]
        elif name == "iris":
            color = iris
        colors[number] = color
    return colors


def _between(ends: tuple[_Color, _Color], share: float) -> Array:
    """Interpolate the logarithms of two colours, because pigment darkens exponentially."""
    low, high = np.log(ends)
    return np.asarray(np.exp(low + share * (high - low)))
