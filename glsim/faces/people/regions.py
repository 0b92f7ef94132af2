"""Regions of the people's vertices, from the model's own groups, masks and bones.

Groups of the base mesh tell eyes, teeth and tongue; the texture masks in the data tell lips, ears,
lids and the inside of the mouth; the bones tell neck, torso, arms, hands, legs and feet. Nose, brow
and scalp have no group: they are defined around the eyes and the nose of the mean grown person.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from glsim.errors import MeshError
from glsim.faces.people.files import FETCH_AGAIN

_Array = NDArray[np.float64]

REGIONS: Final = (
    "skin", "brow", "scalp", "lips", "sclera", "iris", "pupil", "ear", "neck", "nose", "lids",
    "mouth", "teeth", "torso", "arm", "hand", "leg", "foot",
)  # fmt: skip

MASKS: Final = ("lips", "ears", "eyelids", "inside-mouth", "aureolae", "crotch")
_LIMBS: Final = {  # region -> starts of the names of its bones
    "neck": ("neck",),
    "torso": ("root", "pelvis", "spine", "clavicle", "shoulder"),
    "arm": ("upperarm", "lowerarm"),
    "hand": ("wrist", "finger", "metacarpal"),
    "leg": ("upperleg", "lowerleg"),
    "foot": ("foot",),
}
IRIS_MM: Final = 5.9  # the visible iris of an adult is 11.7 to 11.8 mm wide
PUPIL_MM: Final = 2.0
#: Distance of a brow's inner and outer end from the midline of the mean grown person, mm.
BROW_MM: Final = (9.0, 54.0)

#: The mean grown person's chin begins so far below the lower lip, mm, under the fold; its landmark
#: is the foremost point from there on.
_CHIN_BELOW_LIP_MM: Final = 14.0

# Hairline of the mean grown person: height above the eyes (mm) at z behind the nose tip (mm).
_HAIRLINE_Z: Final = (-220.0, -150.0, -128.0, -118.0, -104.0, -96.0, -88.0, -74.0, -58.0, -40.0)
_HAIRLINE_Y: Final = (-62.0, -58.0, -40.0, -10.0, 2.0, 26.0, 44.0, 58.0, 66.0, 71.0)


def read_masks(folder: Path, texture: _Array) -> _Array:
    """Return (V, M) values in [0, 1] of the MASKS at (V, 2) texture coordinates.

    Raises MeshError for a missing or damaged image.
    """
    columns = []
    for name in MASKS:
        path = folder / "mpfb2" / "textures" / f"mpfb_{name}.jpg"
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
        if image is None:
            raise MeshError(f"{path}: missing or damaged: {FETCH_AGAIN}")
        height, width = image.shape
        column = np.clip(np.rint(texture[:, 0] * (width - 1)), 0, width - 1).astype(int)
        row = np.clip(np.rint((1.0 - texture[:, 1]) * (height - 1)), 0, height - 1).astype(int)
        columns.append(image[row, column] / 255.0)
    return np.stack(columns, axis=1)


def label_regions(
    points: _Array,
    skin: _Array,
    bones: Sequence[str],
    masks: _Array,
    member: _Array,
    groups: Sequence[str],
) -> tuple[NDArray[np.uint8], dict[str, int]]:
    """Return (V,) uint8 indices into REGIONS, and the vertices of landmarks.

    Args:
        points: (V, 3) mm of the mean grown person.
        skin: (V, B) weights of bones.
        masks: (V, M).
        member: (V, G) shares of the groups.
    """  # fmt: skip
    label = np.zeros(len(points), dtype=np.uint8)

    def paint(name: str, inside: NDArray[np.bool_]) -> None:
        label[inside] = REGIONS.index(name)

    limb = np.stack(
        [skin[:, [b.startswith(starts) for b in bones]].sum(axis=1) for starts in _LIMBS.values()]
        + [skin[:, list(bones).index("head")]],
        axis=1,
    ).argmax(axis=1)
    for number, name in enumerate(_LIMBS):
        paint(name, limb == number)
    body = member[:, groups.index("body")] > 0.5
    face = body & (limb == len(_LIMBS))
    eyes = [member[:, groups.index(f"helper-{side}-eye")] > 0.5 for side in "lr"]
    level = float(np.mean([points[eye, 1].max() + points[eye, 1].min() for eye in eyes])) / 2
    x, y = np.abs(points[:, 0]), points[:, 1] - level
    between = face & (x < 3.0) & (y < -20.0) & (y > -55.0)
    tip = int(np.flatnonzero(between)[points[between, 2].argmax()])
    z = points[:, 2] - points[tip, 2]
    inside_mouth = body & (masks[:, MASKS.index("inside-mouth")] > 0.5)
    paint("nose", face & (x < _nose_half_width(y)) & (z > -42.0))
    paint("scalp", face & (y > np.interp(z, _HAIRLINE_Z, _HAIRLINE_Y)))
    paint("brow", face & _on_brow(x, y) & (z > -60.0))
    paint("lids", body & (masks[:, MASKS.index("eyelids")] > 0.5))
    paint("ear", body & (masks[:, MASKS.index("ears")] > 0.5))
    paint("lips", body & (masks[:, MASKS.index("lips")] > 0.5))
    paint("mouth", inside_mouth)
    paint("mouth", member[:, groups.index("helper-tongue")] > 0.5)
    for arch in ("upper", "lower"):
        paint("teeth", member[:, groups.index(f"helper-{arch}-teeth")] > 0.5)
    for eye in eyes:
        centre = points[eye].min(axis=0) / 2 + points[eye].max(axis=0) / 2
        off = np.hypot(*(points[:, :2] - centre[:2]).T)
        paint("sclera", eye)
        paint("iris", eye & (off < IRIS_MM))
        paint("pupil", eye & (off < PUPIL_MM))
    lower_lip = y[(label == REGIONS.index("lips")) & (x < 3.0)].min()
    below = face & (x < 3.0) & (y < lower_lip - _CHIN_BELOW_LIP_MM) & (y > -120.0)
    chin = int(np.flatnonzero(below)[points[below, 2].argmax()])
    return label, {"nose_tip": tip, "chin": chin}


def _nose_half_width(y: _Array) -> _Array:
    """Half the width of the nose at heights above the eyes, mm: 0 below its base."""
    return np.interp(y, (-52.0, -48.0, -32.0, -12.0, 4.0), (0.0, 18.0, 18.0, 12.0, 9.0), right=0.0)


def brow_arch(x: _Array) -> _Array:
    """Return the middle of a brow, mm above the eyes, at distances from the midline, mm."""
    along = _along_brow(x)
    return 17.0 + 6.0 * np.sin(np.pi * np.minimum(0.75 * along, 1.0)) - 5.0 * along**3


def _along_brow(x: _Array) -> _Array:
    """Return the place along a brow, 0 at its inner and 1 at its outer end."""
    return np.clip((x - BROW_MM[0]) / (BROW_MM[1] - BROW_MM[0]), 0.0, 1.0)


def _on_brow(x: _Array, y: _Array) -> NDArray[np.bool_]:
    """Brows are 45 mm long and 7 mm high, thinner outside."""
    inside = (x > BROW_MM[0]) & (x < BROW_MM[1])
    return inside & (np.abs(y - brow_arch(x)) < 4.0 - 2.0 * _along_brow(x))
