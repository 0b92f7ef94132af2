"""Face regions of the template's vertices, and where lips, hair and brows cover it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from glsim.faces.procedural.lids import EYE_RADIUS
from glsim.faces.procedural.model import REGIONS
from tools.heads import mouth
from tools.heads.eyes import IRIS_RADIUS, PUPIL_RADIUS
from tools.heads.falloff import Array, smoothstep
from tools.heads.template import (
    PART_EAR,
    PART_EYE_LINING,
    PART_EYEBALL,
    PART_MOUTH_LINING,
    PART_SKIN,
    PART_TEETH,
    Template,
)

# Hairline: y above which there is hair (mm) as a function of z (mm), nape to forehead.
HAIRLINE_Z = (-200.0, -150.0, -115.0, -98.0, -84.0, -70.0, -62.0, -52.0, -35.0, -15.0, 3.0, 20.0)
HAIRLINE_Y = (-62.0, -58.0, -45.0, -16.0, 8.0, 14.0, 30.0, 48.0, 64.0, 74.0, 80.0, 84.0)


def hair_weight(points: Array, soft_mm: float = 6.0) -> Array:
    """Return (V,) weights of hair on the skin, rising to 1 within ``soft_mm`` of the hairline."""
    line = np.interp(points[:, 2], HAIRLINE_Z, HAIRLINE_Y)
    return np.asarray(smoothstep(-2.0, soft_mm, points[:, 1] - line))


def brow_arch(x: Array) -> Array:
    """Return the height (N,) of the brows' middle line at distances from the midline, mm."""
    s = np.clip((x - 9.0) / 44.0, 0.0, 1.0)
    return np.asarray(30.5 + 7.0 * np.sin(np.pi * np.minimum(0.78 * s, 1.0)) - 4.5 * s**3)


def brow_weight(points: Array) -> Array:
    """Return (V,) weights of the brows: arches of about 45 x 7 mm, thinner outwards."""
    x, y = np.abs(points[:, 0]), points[:, 1]
    s = np.clip((x - 9.0) / 44.0, 0.0, 1.0)
    half = 4.4 - 2.9 * s
    inside = smoothstep(7.0, 12.0, x) * smoothstep(54.0, 47.0, x) * (points[:, 2] > -45)
    return np.asarray(inside * np.exp(-(((y - brow_arch(x)) / half) ** 4)))


def make_regions(template: Template) -> NDArray[np.uint8]:
    """Return (V,) uint8 indices into REGIONS."""
    points, part = template.points, template.part
    x, y, z = np.abs(points[:, 0]), points[:, 1], points[:, 2]
    label = np.zeros(len(points), dtype=np.uint8)

    def paint(name: str, inside: np.ndarray) -> None:
        label[inside] = REGIONS.index(name)

    skin = part == PART_SKIN
    front = skin & (z > -50)
    paint("forehead", front & (y > 40))
    paint("cheek", skin & (z > -62) & (y < 4) & (y > -66) & (x > 22))
    paint("chin", front & (y < -63) & (x < 24))
    jaw_line = np.interp(z, (-92.0, -60.0, -20.0, 5.0, 15.0), (-20.0, -68.0, -88.0, -94.0, -99.0))
    paint("neck", skin & (y < np.where(z < -92, 0.0, jaw_line)))
    # below the clavicles and on the slope of the shoulders
    wide = np.hypot(x, z + 104.0) > np.interp(y, (-150.0, -120.0), (64.0, 78.0))
    paint("shoulder", skin & ((y < -166.0) | ((y < -118.0) & wide)))
    nose_half = np.interp(y, (-30, -15, 5, 25), (17.5, 17.0, 12.0, 8.0))
    paint("nose", front & (y > -29.5) & (y < 26) & (x < nose_half) & (z > 8))
    ball = np.hypot(x - 32, (y - 15) * 1.25)
    paint("lids", front & (ball < 17) & (z > -25) & (label != REGIONS.index("nose")))
    paint("hair", skin & (hair_weight(points) > 0.5))
    paint("brow", front & (brow_weight(points) > 0.5))
    paint("lips", front & (mouth.lip_weight(x, y) > 0.5) & (z > -20))
    paint("ear", part == PART_EAR)
    paint("mouth", part == PART_MOUTH_LINING)
    paint("teeth", part == PART_TEETH)
    ball_angle = np.arcsin(np.array([PUPIL_RADIUS, IRIS_RADIUS]) / EYE_RADIUS) + 0.01
    paint("sclera", part == PART_EYEBALL)
    paint("iris", (part == PART_EYEBALL) & (template.eye_angle < ball_angle[1]))
    paint("pupil", (part == PART_EYEBALL) & (template.eye_angle < ball_angle[0]))
    paint("lids", part == PART_EYE_LINING)
    return label


def cover_weights(template: Template) -> Array:
    """Return (3, V) weights of lips, hair and brows, for the reflectivity of a subject."""
    points, on_skin = template.points, template.part == PART_SKIN
    x, y, z = np.abs(points[:, 0]), points[:, 1], points[:, 2]
    lips = mouth.lip_weight(x, y) * (on_skin & (z > -20))
    return np.array([lips, hair_weight(points) * on_skin, 0.85 * brow_weight(points) * on_skin])
