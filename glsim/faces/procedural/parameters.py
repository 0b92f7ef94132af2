"""The table of identity parameters, and the drawing of random identities.

A parameter is a measurement of the finished head (mm or degrees), or, if no standard measurement
exists, a deviation from the template in mm (mean 0).

Sources (short names in the table):
  F   L. G. Farkas, "Anthropometry of the Head and Face", 2nd ed., Raven 1994, and between
      populations L. G. Farkas et al., J. Craniofac. Surg. 16, 2005 (25 groups)
  A   ANSUR II, C. C. Gordon et al., NATICK/TR-15/007, 2014 (US Army personnel)
  Z   Z. Zhuang, B. Bradtmiller, "Head-and-face anthropometric survey of U.S. respirator users",
      J. Occup. Environ. Hyg. 2, 2005 (3,997 adults of four groups; go-go over the skin, F presses
      the caliper to the bone)
  H   M. E. Migliori, G. J. Gladstone, Am. J. Ophthalmol. 98, 1984 (exophthalmometry, adults)
  E   estimated for this model, as no norm exists; heads at 3 sd still look human
Means and sds are pooled over sexes and populations: sd^2 within groups plus that between them.

Measures of one person go together. Each parameter is a sum of what it owes to the factors of the
person (``FACTORS``) and of its own part; the numbers in the table are the correlations with them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.core.seeds import rng_for

#: Factors of a person, each of mean 0 and sd 1: sex (+1 male, -1 female), size of the body, body
#: fat, age (-1 about 20 years, +2 about 70), and two axes of differences between populations: broad
#: low nose with full lips, and flat midface with a low nasal root and full upper lids.
FACTORS = ("male", "size", "fat", "age", "broad", "flat")


@dataclass(frozen=True)
class IdentityParameter:
    """An identity parameter: a normal distribution clipped to [low, high].

    Args:
        loads: its correlations with the factors, in the order of FACTORS.
    """

    name: str
    mean: float
    sd: float
    low: float
    high: float
    unit: str
    source: str
    loads: tuple[float, ...]
    help: str
    template: float = 0.0  # value of the template head


def _p(
    name: str, mean: float, sd: float, source: str, help: str,
    male: float = 0.0, fat: float = 0.0, age: float = 0.0, size: float = 0.0,
    broad: float = 0.0, flat: float = 0.0, unit: str = "mm",
    low: float | None = None, high: float | None = None, template: float | None = None,
) -> IdentityParameter:  # fmt: skip
    """Make a row of the parameter table; the default range is mean +- 3 sd."""
    low = mean - 3 * sd if low is None else low
    high = mean + 3 * sd if high is None else high
    template = mean if template is None else template
    loads = (male, size, fat, age, broad, flat)
    return IdentityParameter(name, mean, sd, low, high, unit, source, loads, help, template)


PARAMETERS: tuple[IdentityParameter, ...] = (
    # the skull
    _p("head_breadth", 149, 6.4, "F Z", "eu-eu, the greatest width of the skull", 0.4, size=0.35,
       flat=0.25),
    _p("head_length", 193, 8.6, "F Z", "g-op, glabella to the back of the head", 0.5, size=0.4,
       flat=-0.25),
    _p("head_height", 133, 6.5, "F", "crown above the middle of the face", 0.35, size=0.4),
    _p("forehead_breadth", 0, 3.0, "F", "ft-ft relative to the mean", 0.3, size=0.3),
    _p("forehead_slope", 0, 5.0, "E", "backwards lean of the forehead", 0.5, unit="deg"),
    _p("forehead_bulge", 0, 1.7, "E", "frontal bosses", -0.4, broad=0.2),
    _p("brow_ridge", 0, 2.0, "E", "prominence of the supraorbital ridge", 0.6, flat=-0.3),
    _p("brow_height", 0, 2.3, "F", "height of the brow above the eye", -0.45, age=-0.25),
    _p("temple_hollow", 0, 1.9, "E", "depth of the temporal fossa", 0.1, -0.5, age=0.3),
    # the middle of the face
    _p("face_breadth", 137, 7.2, "F Z", "zy-zy, bizygomatic width", 0.45, 0.3, size=0.35,
       flat=0.3),
    _p("face_height", 119, 7.4, "F Z", "n-gn, nasion to the underside of the chin", 0.5, size=0.4),
    _p("midface_depth", 0, 1.8, "E", "prominence of nose and upper jaw", 0.1, flat=-0.7),
    _p("cheekbone", 0, 2.0, "E", "forward prominence of the zygoma", flat=0.4, fat=-0.1),
    _p("cheek_fullness", 0, 2.8, "E", "buccal fat", 0.0, 0.6, age=-0.35),
    _p("nasolabial_fold", 0.6, 0.8, "E", "depth of the fold", 0.1, 0.15, age=0.7, low=0.0,
       template=0.0),
    _p("facial_fat", 0, 2.0, "E", "subcutaneous fat of cheeks, jaw and throat", 0.0, 0.9),
    _p("jowl", 0.6, 1.6, "E", "sag of the cheek over the jaw", 0.0, 0.35, age=0.7, low=0.0,
       template=0.0),
    # the nose
    _p("nose_height", 52, 3.6, "F Z", "height of the nose, n-sn", 0.35, age=0.25, template=53),
    _p("nose_protrusion", 19.5, 2.5, "F Z", "sn-prn, from subnasale to the tip", 0.2, age=0.2,
       broad=-0.4, flat=-0.3),
    _p("nose_breadth", 36, 4.2, "F Z", "al-al, across the wings", 0.35, broad=0.7, template=34.5),
    _p("nose_hump", 0, 1.7, "E", "height of the dorsum at its middle", 0.25, age=0.15, broad=-0.4,
       flat=-0.2),
    _p("nose_root", 0, 1.9, "E", "depth of the sellion", 0.15, broad=0.3, flat=0.6),
    _p("nose_bridge_breadth", 0, 1.6, "F", "width of the bony bridge", 0.2, broad=0.5),
    _p("nose_tip_breadth", 0, 1.6, "E", "width of the lobule", 0.1, broad=0.5, age=0.2),
    _p("nose_tip_lift", 0, 1.8, "F", "height of the tip (nasolabial angle)", -0.3, age=-0.4),
    _p("nose_deviation", 0, 1.0, "E", "sideways bend"),
    # the eyes
    _p("interocular", 33, 2.8, "F", "en-en, between the inner corners", 0.15, broad=0.3, flat=0.3),
    _p("eye_fissure_length", 29, 1.4, "F", "length of the fissure, en-ex", 0.2),
    _p("eye_fissure_height", 9.9, 1.2, "F", "ps-pi, opening of the lids", -0.1, age=-0.3,
       flat=-0.35),
    _p("canthal_tilt", 0, 1.2, "F", "height of the outer corner", -0.2, age=-0.3, flat=0.4),
    _p("eye_depth", 0, 1.5, "H", "globe behind the orbital rim", 0.2, fat=-0.2, age=0.3, flat=-0.3),
    _p("lid_hood", 0, 1.2, "E", "fullness above the upper lid", 0.1, 0.3, flat=0.5),
    _p("tear_trough", 0.3, 0.7, "E", "furrow under the lower lid", 0.0, -0.2, age=0.5,
       template=0.0),
    _p("eye_bag", 0.3, 0.8, "E", "bulge under the lower lid", 0.1, 0.2, age=0.6, low=0.0,
       template=0.0),
    _p("eye_level_asymmetry", 0, 0.5, "F", "left eye higher than the right"),
    # the mouth
    _p("mouth_width", 51.5, 4.2, "F Z", "width of the mouth, ch-ch", 0.3, broad=0.3, age=0.2,
       template=52.7),
    _p("upper_lip", 0, 1.6, "F", "height of the upper vermilion", -0.15, age=-0.4, broad=0.6),
    _p("lower_lip", 0, 1.6, "F", "height of the lower vermilion", -0.1, age=-0.3, broad=0.6),
    _p("lip_protrusion", 0, 1.8, "F", "protrusion of both lips relative to the face", broad=0.6,
       age=-0.25),
    _p("philtrum_length", 0, 2.1, "F", "sn-ls relative to the mean", 0.35, age=0.4),
    _p("philtrum_depth", 0, 0.5, "E", "depth of the groove", age=-0.3),
    _p("mouth_tilt", 0, 0.7, "F", "left corner higher than the right"),
    # the jaw
    _p("jaw_breadth", 109, 7.5, "F Z", "go-go, across the jaw, skin to skin", 0.45, 0.4, size=0.3),
    _p("jaw_angle_height", 0, 4.5, "E", "height of the gonion", -0.4),
    _p("chin_protrusion", 0, 3.0, "F", "pogonion relative to the mean", 0.25, broad=-0.2),
    _p("chin_breadth", 0, 3.2, "E", "width of the mental tubercles", 0.5),
    _p("chin_height", 0, 2.6, "F", "sl-gn relative to the mean", 0.35),
    _p("chin_cleft", 0.2, 0.5, "E", "depth of the cleft", 0.3, low=0.0, template=0.0),
    _p("double_chin", 0.5, 3.0, "E", "fat under the chin", 0.0, 0.7, age=0.3, template=0.0),
    _p("jaw_asymmetry", 0, 1.0, "F", "chin to the left"),
    # neck, shoulders, ears, hair
    _p("neck_breadth", 114, 8.0, "A", "width under the jaw", 0.6, 0.45),
    _p("neck_length", -12, 6.5, "E", "distance from head to shoulders, relative to the template",
       -0.3, -0.3, size=0.3, template=0.0),
    _p("adams_apple", 1.2, 1.5, "E", "laryngeal prominence", 0.7, -0.2, low=0.0, template=0.0),
    _p("shoulder_breadth", 390, 28, "A", "biacromial breadth", 0.75, size=0.4, low=325, high=460),
    _p("shoulder_drop", 0, 8.0, "E", "height by which the shoulders hang", -0.2, age=0.3),
    _p("chest_depth", 250, 26, "A", "front to back", 0.25, 0.65, size=0.2, low=195, high=325),
    _p("stoop", 0, 8.0, "E", "head in front of the shoulders", 0.0, 0.1, age=0.5),
    _p("ear_length", 62, 4.6, "F", "length of the ear, sa-sba", 0.4, age=0.5),
    _p("ear_protrusion", 0, 6.5, "F", "angle of the ear to the head", 0.1, unit="deg"),
    _p("hair_volume", 3, 3.0, "E", "hair cap; 0 is bald", -0.3, low=0.0, high=9, template=0.0),
)  # fmt: skip


def sample_factors(rng: np.random.Generator) -> NDArray[np.float64]:
    """Draw a person's factors (len(FACTORS),): sex, size, fat, age, breadth and flatness."""
    sex = 1.0 if rng.random() < 0.5 else -1.0
    return np.array([sex, *np.clip(rng.standard_normal(len(FACTORS) - 1), -2.0, 2.5)])


def sample_identity(seed: int, subject: str) -> dict[str, float]:
    """Draw a subject's identity: parameter -> value; a pure function of its arguments."""
    rng = rng_for(seed, "identity", subject)
    factors = sample_factors(rng)
    values = {}
    for p in PARAMETERS:
        loads = np.array(p.loads)
        own = np.sqrt(max(1.0 - float((loads * loads).sum()), 0.0)) * float(rng.standard_normal())
        values[p.name] = float(
            np.clip(p.mean + p.sd * ((loads * factors).sum() + own), p.low, p.high)
        )
    return values
