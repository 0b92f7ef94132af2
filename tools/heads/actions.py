"""Table of FACS action units as pulls on the skin.

At full intensity a pull displaces the skin around ``center`` by ``move`` mm, weighted by exp(-d^2)
with d = 1 at ``radii``. x points away from the midline; left and right are separate units
("AU12_L"). ``lips`` restricts a pull to skin above or below the line of the mouth. Muscles and
directions follow P. Ekman, W. V. Friesen, J. C. Hager, "Facial Action Coding System", 2002; sizes
follow excursions of posed maxima (lip corner 10-16 mm, brow 5-10 mm: C. J. Linstrom et al.,
Am. J. Otol. 21, 2000; C. Trotman et al., Cleft Palate Craniofac. J. 1998).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from tools.heads.falloff import Vec3

BOTH, UPPER, LOWER = "both", "upper", "lower"


@dataclass(frozen=True)
class Pull:
    """A displacement of the skin near ``center`` by ``move``; all in mm on the template."""

    center: Vec3
    radii: Vec3
    move: Vec3
    lips: str = BOTH


@dataclass(frozen=True)
class ActionUnit:
    """An action unit: its pulls, and the motion of lids and jaw at full intensity.

    Args:
        upper_lid, lower_lid: share by which the lid closes; negative: it opens.
        jaw_deg: rotation that opens the jaw about the temporomandibular joint.
        jaw_slide: translation of the jaw, mm.
    """

    name: str
    muscle: str
    pulls: tuple[Pull, ...] = ()
    upper_lid: float = 0.0
    lower_lid: float = 0.0
    jaw_deg: float = 0.0
    jaw_slide: Vec3 = (0.0, 0.0, 0.0)


ACTION_UNITS: tuple[ActionUnit, ...] = (
    ActionUnit("AU1", "inner brow raiser: frontalis, pars medialis", (
        Pull((14, 38, 16), (15, 17, 30), (-0.6, 8.0, 0.8)),
        Pull((10, 62, 14), (18, 16, 40), (0, 2.0, 0.4)),
    )),
    ActionUnit("AU2", "outer brow raiser: frontalis, pars lateralis", (
        Pull((42, 38, -2), (17, 16, 30), (0.5, 7.5, -1.2)),
        Pull((40, 60, -5), (18, 16, 40), (0, 2.2, 0)),
        Pull((40, 27, 2), (13, 5, 20), (0, 2.0, -1.0)),
    )),
    ActionUnit("AU4", "brow lowerer: corrugator supercilii, procerus", (
        Pull((16, 33, 15), (15, 13, 26), (-4.0, -6.0, 1.6)),
        Pull((36, 34, 4), (16, 10, 26), (-2.0, -2.5, 0.5)),
        Pull((0, 33, 18), (5, 9, 20), (0, -2.5, 1.2)),
    )),
    ActionUnit("AU5", "upper lid raiser: levator palpebrae", upper_lid=-0.34),
    ActionUnit("AU6", "cheek raiser: orbicularis oculi, pars orbitalis", (
        Pull((38, -6, 5), (17, 12, 24), (-0.6, 5.0, 3.0)),
        Pull((53, 14, -16), (10, 13, 20), (-2.2, 1.0, 0.5)),
        Pull((35, 5, 6), (14, 4.5, 18), (0, 1.8, 1.2)),
    ), upper_lid=0.10, lower_lid=1.0),
    ActionUnit("AU7", "lid tightener: orbicularis oculi, pars palpebralis", (
        Pull((34, 4, 6), (15, 5, 18), (-0.5, 1.2, 0.4)),
    ), upper_lid=0.18, lower_lid=1.3),
    ActionUnit("AU9", "nose wrinkler: levator labii superioris alaeque nasi", (
        Pull((12, -20, 22), (10, 12, 20), (0.8, 5.0, -0.6)),
        Pull((9, 10, 16), (8, 12, 18), (-0.8, 3.0, 1.8)),
        Pull((14, 31, 15), (13, 9, 22), (-1.8, -3.2, 0.8)),
        Pull((14, -40, 20), (13, 9, 22), (0.5, 3.6, 0.8), UPPER),
        Pull((24, -14, 12), (9, 13, 20), (-1.0, 2.6, 2.2)),
    ), lower_lid=0.5),
    ActionUnit("AU10", "upper lip raiser: levator labii superioris", (
        Pull((13, -43, 21), (13, 10, 24), (0.6, 6.5, 1.0), UPPER),
        Pull((25, -26, 14), (10, 13, 20), (0.4, 3.4, 2.6)),
        Pull((14, -22, 20), (8, 9, 16), (0.8, 1.8, 0)),
    )),
    ActionUnit("AU12", "lip corner puller: zygomaticus major", (
        Pull((27, -48.5, 12), (13, 10, 22), (8.0, 6.5, -5.0)),
        Pull((36, -46, 4), (9, 11, 22), (1.5, 3.0, 2.2)),
        Pull((29, -37, 14), (5.5, 11, 22), (0, 0, -1.8)),
        Pull((15, -51, 20), (10, 11, 22), (2.6, 1.0, -2.0)),
        Pull((38, -26, 6), (13, 15, 24), (3.0, 5.0, 3.2)),
        Pull((36, -8, 6), (14, 10, 24), (0, 2.8, 2.0)),
        Pull((15, -24, 22), (8, 8, 16), (1.8, 0.6, -0.4)),
    ), lower_lid=0.3),
    ActionUnit("AU14", "dimpler: buccinator", (
        Pull((28, -49, 10), (9, 9, 20), (3.6, 0.4, -5.0)),
        Pull((39, -46, 0), (9, 13, 20), (0, 0, 2.0)),
    )),
    ActionUnit("AU15", "lip corner depressor: depressor anguli oris", (
        Pull((26, -51, 12), (11, 9, 22), (1.0, -7.0, -0.8)),
        Pull((24, -63, 8), (11, 11, 22), (0.8, -2.6, 1.4)),
    )),
    ActionUnit("AU16", "lower lip depressor: depressor labii inferioris", (
        Pull((9, -56, 20), (14, 9, 22), (0.8, -6.5, 0.8), LOWER),
        Pull((11, -67, 16), (14, 9, 22), (0.6, -2.5, 0.6), LOWER),
    )),
    ActionUnit("AU17", "chin raiser: mentalis", (
        Pull((6, -78, 16), (15, 11, 24), (0, 4.5, 1.8)),
        Pull((7, -57, 20), (16, 10, 24), (0, 3.2, 3.4), LOWER),
        Pull((7, -47, 20), (16, 7, 24), (0, 1.8, 1.0), UPPER),
    )),
    ActionUnit("AU18", "lip pucker: incisivii labii", (
        Pull((26, -49, 12), (13, 12, 24), (-10.0, 0, 6.0)),
        Pull((8, -49, 22), (14, 11, 26), (-2.0, 0, 7.0)),
        Pull((5, -41, 22), (10, 4.5, 22), (0, 2.2, 1.5), UPPER),
        Pull((5, -58, 22), (10, 5, 22), (0, -2.2, 1.5), LOWER),
    )),
    ActionUnit("AU20", "lip stretcher: risorius", (
        Pull((28, -51, 10), (13, 12, 24), (8.0, -2.2, -4.6)),
        Pull((14, -50, 20), (11, 11, 24), (2.4, -0.4, -2.0)),
    )),
    ActionUnit("AU22", "lip funneler: orbicularis oris", (
        Pull((24, -49, 12), (13, 12, 24), (-6.0, 0, 5.0)),
        Pull((7, -44, 22), (15, 8, 24), (0, 3.4, 6.0), UPPER),
        Pull((7, -55, 22), (15, 9, 24), (0, -3.8, 6.5), LOWER),
    )),
    ActionUnit("AU23", "lip tightener: orbicularis oris", (
        Pull((26, -49, 12), (12, 10, 22), (-3.0, 0, 1.2)),
        Pull((8, -43, 22), (16, 5, 22), (0, -2.0, -0.8), UPPER),
        Pull((8, -57, 22), (16, 6, 22), (0, 2.6, -0.8), LOWER),
    )),
    ActionUnit("AU24", "lip pressor: orbicularis oris", (
        Pull((8, -43, 22), (18, 5, 22), (0, -2.4, -1.8), UPPER),
        Pull((8, -57, 22), (18, 6, 22), (0, 3.0, -1.8), LOWER),
        Pull((26, -49, 12), (10, 9, 22), (-1.4, 0, -0.5)),
    )),
    ActionUnit("AU25", "lips part", (
        Pull((3, -55, 20), (20, 10, 24), (0, -4.0, -0.3), LOWER),
        Pull((3, -45, 20), (20, 9, 24), (0, 1.6, 0.3), UPPER),
    )),
    ActionUnit("AU26", "jaw drop: masseter and pterygoid relaxed", jaw_deg=10.0,
               jaw_slide=(0, -1.0, 0.8)),
    ActionUnit("AU27", "mouth stretch: pterygoids, digastric", jaw_deg=20.0,
               jaw_slide=(0, -2.0, 2.5)),
    ActionUnit("AU28", "lip suck: orbicularis oris", (
        Pull((6, -44, 22), (19, 7, 22), (0, -2.6, -4.6), UPPER),
        Pull((6, -56, 22), (19, 8, 22), (0, 3.2, -5.0), LOWER),
    ), jaw_deg=2.0),
    ActionUnit("AU43", "eyes closed: levator palpebrae relaxed", (
        Pull((32, 28, 6), (18, 5, 20), (0, -1.2, 0.2)),
    ), upper_lid=1.0, lower_lid=1.0),
    ActionUnit("AU45", "blink", upper_lid=1.0, lower_lid=1.0),
)  # fmt: skip

BY_NAME: Mapping[str, ActionUnit] = {unit.name: unit for unit in ACTION_UNITS}
