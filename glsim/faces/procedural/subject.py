"""One procedural head: neutral shape, asymmetry, reflectivity, and expressions.

Reflectivity is at 860 nm, relative to a white wall (0.85-0.9 absolute). Skin at 860 nm reflects
0.5-0.6 on average, 0.40-0.68 over people (C. C. Cooksey, D. W. Allen, B. K. Tsai, J. Res. NIST 122,
2017; J. A. Jacquez et al., J. Appl. Physiol. 8, 1955): 0.60-0.65 of the wall; hair and brows
0.05-0.3, sclera 0.4-0.6, lips close to skin, pupil dark.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Array
from glsim.core.products import product
from glsim.core.seeds import rng_for
from glsim.faces.procedural.expression import expression_weights, lid_and_jaw_shapes
from glsim.faces.procedural.model import REGIONS, head_model
from glsim.faces.procedural.parameters import PARAMETERS
from glsim.faces.sparse_shapes import SparseShapes

# Mean, sd, minimum and maximum over people of the reflectivity.
SKIN_ALBEDO: Final = (0.60, 0.045, 0.45, 0.75)
HAIR_ALBEDO: Final = (0.20, 0.06, 0.08, 0.32)
FIXED_ALBEDO: Final = {"sclera": 0.50, "iris": 0.20, "pupil": 0.06, "mouth": 0.35, "teeth": 0.60}
LIPS_TO_SKIN: Final = 0.92  # reflectivity of lips over that of the person's skin
STUBBLE_TO_SKIN: Final = 0.9  # reflectivity of a bald scalp over that of the person's skin
_BALD_MM: Final = 0.8  # thickness of hair that shows the scalp

#: Wavelengths of the asymmetry, mm: from a head's width to a cheek's; amplitudes are proportional.
WAVELENGTHS_MM: Final = (260.0, 150.0, 90.0)
WAVES: Final = 4  # waves per wavelength, enough for a nearly Gaussian field
#: Standard deviation of the field in each direction, mm, and its spread over people. Faces and
#: their registered mirror images differ by 0.63 mm root mean square (sd 0.16) over 350 adults
#: (Cleft Palate Craniofac. J., doi 10.1597/13-353). Field and asymmetric parameters together give
#: this (test_procedural.py measures it), and landmarks whose sides differ by 1 to 3 mm.
FIELD_MM, SPREAD = 0.42, 0.25
LIMITS_MM: Final = (0.15, 0.8)


@dataclass(frozen=True, eq=False)
class HeadSubject:
    """The neutral head of a person (V, 3) mm, reflectivity (V,) and shapes of lids and jaw."""

    neutral: Array
    albedo: NDArray[np.float32]
    lids_and_jaw: SparseShapes

    def frame(self, expression: Mapping[str, float]) -> NDArray[np.float32]:
        """Compute the head's vertices (V, 3) float32 mm with an expression."""
        model = head_model()
        pulls, lids_and_jaw = expression_weights(model, expression)
        head = self.neutral.astype(np.float32)
        model.pulls.add(head, pulls)
        self.lids_and_jaw.add(head, lids_and_jaw)
        return head


def make_subject(identity: Mapping[str, float], seed: int, name: str) -> HeadSubject:
    """Make a subject of an identity; ``seed`` and ``name`` decide asymmetry and reflectivity."""
    albedo = sample_albedo(seed, name, identity["hair_volume"])
    return subject_of(neutral_head(identity) + asymmetry_field(seed, name), albedo)


def subject_of(neutral: Array, albedo: NDArray[np.float32]) -> HeadSubject:
    """Make a subject from the vertices (V, 3) mm of a neutral head and its albedo (V,)."""
    model = head_model()
    eyeball, left = model.in_regions("sclera", "iris", "pupil"), model.template_mm[:, 0] > 0
    moved = neutral - model.template_mm
    sides = zip(model.anchors_mm[:2], (left, ~left), strict=True)
    globes = np.array([centre + moved[eyeball & side].mean(axis=0) for centre, side in sides])
    return HeadSubject(neutral, albedo, lid_and_jaw_shapes(model, neutral, globes))


def neutral_head(identity: Mapping[str, float]) -> Array:
    """Compute the neutral head (V, 3) float64 mm of an identity (parameter -> value)."""
    model = head_model()
    head = model.template_mm.copy()
    model.identity.add(head, {p.name: identity[p.name] - p.template for p in PARAMETERS})
    return head


def asymmetry_field(seed: int, subject: str) -> Array:
    """Draw a smooth asymmetry of a head as vertex offsets (V, 3) mm.

    Random plane waves minus their mirror images, so that the mean of a head and its mirror image
    stays. Eyeballs and ears stay rigid.
    """
    model = head_model()
    rng = rng_for(seed, "asymmetry", subject)
    size = np.clip(FIELD_MM * np.exp(SPREAD * rng.standard_normal()), *LIMITS_MM)
    length = np.repeat(WAVELENGTHS_MM, WAVES)
    wave = rng.standard_normal((3, len(length)))
    wave *= 2 * np.pi / (length * np.linalg.norm(wave, axis=0))
    phase = rng.uniform(0, 2 * np.pi, len(length))
    amplitude = rng.standard_normal((len(length), 3)) * length[:, None]
    # A wave's mean square is half its squared amplitude, and a quarter for two halved waves.
    amplitude *= 2.0 * size / np.sqrt(np.sum(length**2))
    mirror = np.array([-1.0, 1.0, 1.0])
    # By columns, (waves, V): NumPy is fast along the last axis.
    points = np.concatenate([model.template_mm, model.anchors_mm]).T.astype(np.float32, order="C")
    shift, half = phase[:, None].astype(np.float32), 0.5 * amplitude.T.astype(np.float32)
    here, there = (
        product(half, np.cos(product(direction.T.astype(np.float32), points) + shift)).T
        for direction in (wave, mirror[:, None] * wave)
    )
    moved = here - there * mirror.astype(np.float32)
    field: NDArray[np.floating]
    field, anchors = np.split(moved, [len(model.template_mm)])
    for (vertices, weights), anchor in zip(model.rigid, anchors, strict=True):
        change = weights[:, None] * (anchor - field[vertices])
        field = field.astype(np.float64, copy=False)  # last: sums stay equal
        field[vertices] += change
    return np.asarray(field, np.float64)


def clipped_normal(
    rng: np.random.Generator, mean: float, sd: float, low: float, high: float
) -> float:
    """Draw a normally distributed number of this mean and deviation, clipped to [low, high]."""
    return float(np.clip(rng.normal(mean, sd), low, high))


def sample_albedo(seed: int, subject: str, hair_mm: float) -> NDArray[np.float32]:
    """Draw a subject's reflectivity (V,) in [0, 1]; ``hair_mm``: thickness of the hair."""
    model = head_model()
    rng = rng_for(seed, "albedo", subject)
    skin, hair = clipped_normal(rng, *SKIN_ALBEDO), clipped_normal(rng, *HAIR_ALBEDO)
    albedo = np.full(len(model.template_mm), skin)
    # blood and glands: low-frequency patches of a few per cent
    phases = rng.uniform(0, 2 * np.pi, (6, 3))
    waves = rng.normal(0, 0.06, (6, 3))
    patches = sum(
        np.cos(product(model.template_mm, w) + p.sum()) for w, p in zip(waves, phases, strict=True)
    )
    albedo *= 1.0 + 0.008 * patches
    scalp = hair if hair_mm > _BALD_MM else STUBBLE_TO_SKIN * skin
    covers = LIPS_TO_SKIN * skin, scalp, min(hair, 0.28)
    for weight, value in zip(model.cover, covers, strict=True):
        albedo += weight * (value - albedo)
    for name, value in FIXED_ALBEDO.items():
        albedo[model.regions == REGIONS.index(name)] = value
    return np.asarray(np.clip(albedo, 0.02, 0.95), dtype=np.float32)
