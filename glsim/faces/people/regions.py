"""Regions and landmarks of the people's vertices.

Groups of the base mesh tell eyes, teeth and tongue; the texture masks in the data tell lips, ears,
lids and the inside of the mouth; the bones tell neck, torso, arms, hands, legs and feet. Nose, brow
and scalp have no group: they are defined around the eyes and the nose of the mean grown person.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.faces.people.model import REGIONS

_Array = NDArray[np.float64]

_LIMBS: Final[dict[str, tuple[str, ...]]] = {  # region -> starts of the names of its bones
    "neck": ("neck",),
    "torso": ("root", "pelvis", "spine", "clavicle", "shoulder"),
    "arm": ("upperarm", "lowerarm"),
    "hand": ("wrist", "finger", "metacarpal"),
    "leg": ("upperleg", "lowerleg"),
    "foot": ("foot",),
}
_IRIS_MM: Final = 5.9  # the visible iris of an adult is 11.7 to 11.8 mm wide
_PUPIL_MM: Final = 2.0
#: Distance of a brow's inner and outer end from the midline of the mean grown person, mm.
_BROW_MM: Final = (9.0, 54.0)

# Hairline of the mean grown person: height above the eyes (mm) at z behind the nose tip (mm).
_HAIRLINE_Z: Final = (-220.0, -150.0, -128.0, -118.0, -104.0, -96.0, -88.0, -74.0, -58.0, -40.0)
_HAIRLINE_Y: Final = (-62.0, -58.0, -40.0, -10.0, 2.0, 26.0, 44.0, 58.0, 66.0, 71.0)

#: The 68 landmarks on the mean grown person, mm from the tip of the nose. Brows, lips and the
#: midline are places that the model itself defines: the arch of the brow, the border of the lips'
#: mask, the deepest and the foremost points of the profile. Eyelids, inner lips and the chin are
#: where the skin turns away from the front. The rest (the contour, the base of the nose, the
#: corners of the eyes) is chosen on a picture of the mean person by the drawings of Multi-PIE
#: (R. Gross et al., Image and Vision Computing 28, 2010). Commit 6e9b96b computes the table.
_LANDMARKS_MM: Final = (
    # jaw
    (-72.7, 30.1, -97.7), (-71.3, 12.8, -94), (-67.3, -9, -85.9), (-63.4, -25.8, -82.9),
    (-54.1, -46.3, -70.6), (-41.3, -60.9, -56.5), (-30.4, -68.4, -44.9), (-14.9, -73.6, -30.6),
    (0, -75.8, -27.6), (14.9, -73.6, -30.6), (30.4, -68.4, -44.9), (41.3, -60.9, -56.5),
    (54.1, -46.3, -70.6), (63.4, -25.8, -82.9), (67.3, -9, -85.9), (71.3, 12.8, -94),
    (72.7, 30.1, -97.7),
    # brows
    (-51.8, 55.5, -34.1), (-41.2, 59.7, -25.5), (-30.5, 60, -20.7), (-21.3, 60.2, -18.6),
    (-11.4, 57.2, -17.6), (11.4, 57.2, -17.6), (21.3, 60.2, -18.6), (30.5, 60, -20.7),
    (41.2, 59.7, -25.5), (51.8, 55.5, -34.1),
    # nose
    (0, 39.6, -20.1), (0, 27.2, -16.5), (0, 13.6, -7.4), (0, 0, 0), (-13.6, -11.8, -17.3),
    (-6, -11.7, -12.6), (0, -13.3, -11.4), (6, -11.7, -12.6), (13.6, -11.8, -17.3),
    # eyes
    (-45.2, 38.6, -34.3), (-35.8, 42.3, -27.3), (-27.9, 41.7, -27), (-17, 36, -29.7),
    (-25, 34.4, -29.7), (-36.2, 33.8, -28.7), (17, 36, -29.7), (27.9, 41.7, -27),
    (35.8, 42.3, -27.3), (45.2, 38.6, -34.3), (36.2, 33.8, -28.7), (25, 34.4, -29.7),
    # lips
    (-24.9, -34.6, -23.2), (-14.9, -25, -12.2), (-5.7, -25, -8), (0, -26, -7.1), (5.7, -25, -8),
    (14.9, -25, -12.2), (24.9, -34.6, -23.2), (16.1, -43.3, -17.4), (6.6, -45.7, -13.9),
    (0, -46.2, -13.1), (-6.6, -45.7, -13.9), (-16.1, -43.3, -17.4), (-22.6, -35.5, -22.4),
    (-8.6, -32.5, -15.1), (0, -32.7, -13.9), (8.6, -32.5, -15.1), (22.6, -35.5, -22.4),
    (8.8, -34.9, -14.8), (0, -34.6, -13.4), (-8.8, -34.9, -14.8),
)  # fmt: skip
#: The foremost point of the chin, 14 mm or more below the lower lip, under the fold.
_CHIN_MM: Final = (0.0, -60.7, -19.0)


def find_landmarks(points: _Array, nose_tip: int) -> tuple[NDArray[np.int64], int]:
    """Return the (68,) vertices of landmarks of the mean grown person (V, 3) mm, and the chin's."""
    places = points[nose_tip] + np.array([*_LANDMARKS_MM, _CHIN_MM])
    nearest = [int(np.linalg.norm(points - place, axis=1).argmin()) for place in places]
    return np.array(nearest[:-1], np.int64), nearest[-1]


def label_regions(
    points: _Array,
    bones: Mapping[str, _Array],
    masks: Mapping[str, _Array],
    group: NDArray[np.str_],
) -> tuple[NDArray[np.uint8], int]:
    """Return (V,) uint8 indices into REGIONS, and the vertex at the tip of the nose.

    Args:
        points: (V, 3) mm of the mean grown person.
        bones: bone -> (V,) weights.
        masks: name -> (V,) values in [0, 1].
        group: (V,) name of the group of the base mesh that each vertex is part of.
    """
    label = np.zeros(len(points), dtype=np.uint8)

    def paint(name: str, inside: NDArray[np.bool_]) -> None:
        label[inside] = REGIONS.index(name)

    limb = np.stack(
        [
            np.sum([w for b, w in bones.items() if b.startswith(starts)], axis=0)
            for starts in (*_LIMBS.values(), ("head",))
        ]
    ).argmax(axis=0)
    for number, name in enumerate(_LIMBS):
        paint(name, limb == number)
    body = group == "body"
    face = body & (limb == len(_LIMBS))
    eyes = [group == f"helper-{side}-eye" for side in "lr"]
    level = float(np.mean([points[eye, 1].max() + points[eye, 1].min() for eye in eyes])) / 2
    x, y = np.abs(points[:, 0]), points[:, 1] - level
    between = face & (x < 3.0) & (y < -20.0) & (y > -55.0)
    tip = int(np.flatnonzero(between)[points[between, 2].argmax()])
    z = points[:, 2] - points[tip, 2]
    nose_half = np.interp(
        y, (-52.0, -48.0, -32.0, -12.0, 4.0), (0.0, 18.0, 18.0, 12.0, 9.0), right=0
    )
    paint("nose", face & (x < nose_half) & (z > -42.0))
    paint("scalp", face & (y > np.interp(z, _HAIRLINE_Z, _HAIRLINE_Y)))
    # Brows are 45 mm long and 7 mm high, thinner outside.
    inner, outer = _BROW_MM
    along = np.clip((x - inner) / (outer - inner), 0.0, 1.0)
    arch = 17.0 + 6.0 * np.sin(np.pi * np.minimum(0.75 * along, 1.0)) - 5.0 * along**3
    on_brow = (x > inner) & (x < outer) & (np.abs(y - arch) < 4.0 - 2.0 * along)
    paint("brow", face & on_brow & (z > -60.0))
    for name, mask in (
        ("lids", "eyelids"), ("ear", "ears"), ("lips", "lips"), ("mouth", "inside-mouth"),
    ):  # fmt: skip
        paint(name, body & (masks[mask] > 0.5))
    paint("mouth", group == "helper-tongue")
    paint("teeth", (group == "helper-upper-teeth") | (group == "helper-lower-teeth"))
    for eye in eyes:
        centre = points[eye].min(axis=0) / 2 + points[eye].max(axis=0) / 2
        off = np.hypot(*(points[:, :2] - centre[:2]).T)
        paint("sclera", eye)
        paint("iris", eye & (off < _IRIS_MM))
        paint("pupil", eye & (off < _PUPIL_MM))
    return label, tip
