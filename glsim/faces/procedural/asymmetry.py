"""Smooth differences between the left and the right half of a head.

An antisymmetric field of displacements: random plane waves, minus their mirror images, so that the
mean of a head and its mirror image is unchanged. Eyeballs and ears stay rigid.
"""

from __future__ import annotations

import numpy as np

from glsim.faces.procedural.falloff import Array
from glsim.faces.procedural.fields import FieldPoints, RigidParts
from glsim.geometry.products import product
from glsim.settings.seeds import rng_for

#: Wavelengths, mm: from a head's width to a cheek's; amplitudes are proportional to them.
WAVELENGTHS_MM = (260.0, 150.0, 90.0)
WAVES = 4  # per wavelength: enough to approximate a Gaussian field
#: Standard deviation of the field in each direction, mm, and its spread over people. Faces and
#: their mirror images, registered, differ by 0.63 mm root mean square (sd 0.16) over 350
#: adults (Cleft Palate Craniofac. J., doi 10.1597/13-353). These fields and the
#: asymmetries in the table of parameters together give that size (test_procedural_parts.py
#: measures it), and landmarks on both sides that differ by 1 to 3 mm.
FIELD_MM, SPREAD = 0.42, 0.25
LIMITS_MM = (0.15, 0.8)


def asymmetry_field(points: FieldPoints, rigid: RigidParts, seed: int, subject: str) -> Array:
    """Return a subject's displacement (V, 3) in mm; a pure function of its arguments."""
    rng = rng_for(seed, "asymmetry", subject)
    size = np.clip(FIELD_MM * np.exp(SPREAD * rng.standard_normal()), *LIMITS_MM)
    length = np.repeat(WAVELENGTHS_MM, WAVES)
    wave = rng.standard_normal((3, len(length)))
    wave *= 2 * np.pi / (length * np.linalg.norm(wave, axis=0))
    phase = rng.uniform(0, 2 * np.pi, len(length))
    amplitude = rng.standard_normal((len(length), 3)) * length[:, None]
    # a wave's mean square is half the square of its amplitude; the difference of two waves that are
    # halved has half of it
    amplitude *= 2.0 * size / np.sqrt(np.sum(length**2))
    mirror = np.array([-1.0, 1.0, 1.0])
    # By columns, (waves, V): NumPy is fast along the last axis.
    place = np.ascontiguousarray(points.points.T, np.float32)
    shift, size_of = phase[:, None].astype(np.float32), 0.5 * amplitude.T.astype(np.float32)
    here, there = (
        product(size_of, np.cos(product(part.T.astype(np.float32), place) + shift)).T
        for part in (wave, mirror[:, None] * wave)
    )
    return rigid.apply(here - there * mirror.astype(np.float32))
