"""Table of identity parameters, and random identities.

A parameter is a measurement of the finished head (mm or degrees), or, if no standard measurement
exists, a deviation from the template in mm (mean 0).

Sources (short names in the table):
  F   L. G. Farkas, "Anthropometry of the Head and Face", 2nd ed., Raven 1994 (adult norms; mean and
      sd pooled over the sexes, sd widened to include several populations)
  A   ANSUR II, C. C. Gordon et al., NATICK/TR-15/007, 2014 (US Army personnel)
  Z   Z. Zhuang, B. Bradtmiller, "Head-and-face anthropometric survey of U.S. respirator users",
      J. Occup. Environ. Hyg. 2, 2005 (go-go over the skin; F presses the caliper to the bone)
  H   M. E. Migliori, G. J. Gladstone, Am. J. Ophthalmol. 98, 1984 (exophthalmometry, adults)
  E   estimated for this model, as no norm exists; heads at 3 sd still look human
``sex_correlation`` is the correlation with the sex factor, +1 male (Farkas' male and female means
differ by about twice that many sd), ``fat_correlation`` that with the fat factor.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from glsim.faces.performance import rng_for


@dataclass(frozen=True)
class IdentityParameter:
    """An identity parameter: a normal distribution clipped to [low, high]."""

    name: str
    mean: float
    sd: float
    low: float
    high: float
    unit: str
    source: str
    sex_correlation: float
    fat_correlation: float
    help: str
    template: float = 0.0  # value of the template head


def _p(
    name: str, mean: float, sd: float, source: str, help: str,
    male: float = 0.0, fat: float = 0.0, unit: str = "mm",
    low: float | None = None, high: float | None = None, template: float | None = None,
) -> IdentityParameter:  # fmt: skip
    """Return a row of the table; the default range is mean +- 3 sd."""
    low = mean - 3 * sd if low is None else low
    high = mean + 3 * sd if high is None else high
    template = mean if template is None else template
    return IdentityParameter(name, mean, sd, low, high, unit, source, male, fat, help, template)


PARAMETERS: tuple[IdentityParameter, ...] = (
    # the skull
    _p("head_breadth", 149, 5.5, "F Z", "eu-eu, the greatest width of the skull", 0.45),
    _p("head_length", 193, 7.0, "F Z", "g-op, glabella to the back of the head", 0.5),
    _p("head_height", 133, 6.0, "F", "crown above the middle of the face", 0.35),
    _p("forehead_breadth", 0, 2.5, "F", "ft-ft relative to the mean", 0.3),
    _p("forehead_slope", 0, 4.0, "E", "backwards lean of the forehead", 0.5, unit="deg"),
    _p("forehead_bulge", 0, 1.3, "E", "frontal bosses", -0.4),
    _p("brow_ridge", 0, 1.5, "E", "prominence of the supraorbital ridge", 0.65),
    _p("brow_height", 0, 1.8, "F", "height of the brow above the eye", -0.5),
    _p("temple_hollow", 0, 1.4, "E", "depth of the temporal fossa", 0.1, -0.5),
    # the middle of the face
    _p("face_breadth", 137, 5.0, "F Z", "zy-zy, bizygomatic width", 0.45, 0.25),
    _p("face_height", 119, 6.0, "F Z", "n-gn, nasion to the underside of the chin", 0.5),
    _p("cheekbone", 0, 1.4, "E", "forward prominence of the zygoma"),
    _p("cheek_fullness", 0, 2.0, "E", "buccal fat", 0.0, 0.65),
    _p("nasolabial_fold", 0.6, 0.5, "E", "depth of the fold", 0.1, 0.2, low=0.0, template=0.0),
    _p("facial_fat", 0, 1.1, "E", "subcutaneous fat of cheeks, jaw and throat", 0.0, 0.9),
    # the nose
    _p("nose_height", 53, 3.0, "F", "height of the nose, n-sn", 0.35),
    _p("nose_protrusion", 19.5, 1.9, "F", "sn-prn, from subnasale to the tip", 0.2),
    _p("nose_breadth", 34.5, 2.9, "F", "al-al, across the wings", 0.35),
    _p("nose_hump", 0, 1.3, "E", "height of the dorsum at its middle", 0.3),
    _p("nose_root", 0, 1.4, "E", "depth of the sellion", 0.2),
    _p("nose_bridge_breadth", 0, 1.2, "F", "width of the bony bridge", 0.2),
    _p("nose_tip_breadth", 0, 1.1, "E", "width of the lobule", 0.1),
    _p("nose_tip_lift", 0, 1.6, "F", "height of the tip (nasolabial angle)", -0.35),
    _p("nose_deviation", 0, 0.7, "E", "sideways bend"),
    # the eyes
    _p("interocular", 33, 2.5, "F", "en-en, between the inner corners", 0.2),
    _p("eye_fissure_length", 29, 1.1, "F", "length of the fissure, en-ex", 0.2),
    _p("eye_fissure_height", 9.9, 1.0, "F", "ps-pi, opening of the lids", -0.1),
    _p("canthal_tilt", 0, 0.9, "F", "height of the outer corner", -0.2),
    _p("eye_depth", 0, 1.1, "H", "globe behind the orbital rim", 0.2),
    _p("lid_hood", 0, 0.9, "E", "fullness above the upper lid", 0.1, 0.3),
    _p("tear_trough", 0.3, 0.5, "E", "furrow under the lower lid", 0.0, -0.2, template=0.0),
    _p("eye_level_asymmetry", 0, 0.5, "F", "left eye higher than the right"),
    # the mouth
    _p("mouth_width", 52.7, 3.2, "F", "width of the mouth, ch-ch", 0.3),
    _p("upper_lip", 0, 1.1, "F", "height of the upper vermilion", -0.2),
    _p("lower_lip", 0, 1.2, "F", "height of the lower vermilion", -0.15),
    _p("lip_protrusion", 0, 1.3, "F", "protrusion of both lips relative to the face"),
    _p("philtrum_length", 0, 1.7, "F", "sn-ls relative to the mean", 0.35),
    _p("philtrum_depth", 0, 0.4, "E", "depth of the groove"),
    _p("mouth_tilt", 0, 0.6, "F", "left corner higher than the right"),
    # the jaw
    _p("jaw_breadth", 109, 5.5, "F Z", "go-go, across the jaw, skin to skin", 0.5, 0.35),
    _p("jaw_angle_height", 0, 3.5, "E", "height of the gonion", -0.4),
    _p("chin_protrusion", 0, 2.3, "F", "pogonion relative to the mean", 0.25),
    _p("chin_breadth", 0, 2.5, "E", "width of the mental tubercles", 0.5),
    _p("chin_height", 0, 2.2, "F", "sl-gn relative to the mean", 0.35),
    _p("chin_cleft", 0.2, 0.4, "E", "depth of the cleft", 0.3, low=0.0, template=0.0),
    _p("jaw_asymmetry", 0, 1.0, "F", "chin to the left"),
    # neck, ears, hair
    _p("neck_breadth", 114, 6.5, "A", "width under the jaw", 0.6, 0.4),
    _p("adams_apple", 1.2, 1.2, "E", "laryngeal prominence", 0.7, low=0.0, template=0.0),
    _p("ear_length", 62, 3.6, "F", "length of the ear, sa-sba", 0.4),
    _p("ear_protrusion", 0, 5.0, "F", "angle of the ear to the head", 0.1, unit="deg"),
    _p("hair_volume", 3, 3.0, "E", "hair cap; 0 is bald", -0.3, low=0.0, high=9, template=0.0),
)  # fmt: skip

BY_NAME: Mapping[str, IdentityParameter] = {p.name: p for p in PARAMETERS}


def sample_identity(seed: int, subject: str) -> dict[str, float]:
    """Draw parameter -> value for a subject; a pure function of its arguments."""
    rng = rng_for(seed, "identity", subject)
    sex = 1.0 if rng.random() < 0.5 else -1.0
    fat = float(np.clip(rng.standard_normal(), -2.0, 2.5))
    values = {}
    for p in PARAMETERS:
        own = float(rng.standard_normal())
        rest = np.sqrt(max(1.0 - p.sex_correlation**2 - p.fat_correlation**2, 0.0))
        z = p.sex_correlation * sex + p.fat_correlation * fat + rest * own
        values[p.name] = float(np.clip(p.mean + p.sd * z, p.low, p.high))
    return values


def mean_identity() -> dict[str, float]:
    """Return parameter -> mean."""
    return {p.name: p.mean for p in PARAMETERS}
