"""Random variation of a face: a smooth warp of its shape, and patches of its reflectivity.

A network that is trained on one source of faces also learns its ears, necks and hair lines, and
reproduces them on other people. Varied heads have correct noise, but no longer belong to a real
person. Both fields are sums of plane waves over the canonical frame,
continuous in space: touching surfaces stay in contact.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.mesh import SKIN_ALBEDO
from glsim.core.products import product
from glsim.core.seeds import keyed_rng
from glsim.faces.face_source import Face
from glsim.settings.distribution import ScopeSeeds
from glsim.settings.schema import VariationSettings

#: Wavelengths, mm, from a head's width to an ear's. Amplitudes are proportional to wavelengths, so
#: that all waves have the same slope. A warp with a strain of -1 folds the surface: of 200 fields,
#: none folded below 7.0 mm, and settings allow up to 6 mm.
_WAVELENGTHS_MM: Final = (240.0, 120.0, 60.0)
#: Waves per wavelength: enough to approximate a Gaussian field.
_WAVES: Final = 6
#: Limits of reflectivity on a head, relative to a white wall.
_MIN_ALBEDO, _MAX_ALBEDO = np.float32(0.02), np.float32(0.95)


def sample_variation(settings: VariationSettings, seeds: ScopeSeeds) -> dict[str, float]:
    """Draw a face's "variation.shape_mm" and "variation.albedo"; return {} if both are 0."""
    sampled = {
        "variation.shape_mm": settings.shape_mm.sample(seeds, "variation.shape_mm"),
        "variation.albedo": settings.albedo.sample(seeds, "variation.albedo"),
    }
    return sampled if any(sampled.values()) else {}


def vary(face: Face, settings: VariationSettings, seeds: ScopeSeeds) -> Face:
    """Return a face with varied shape and reflectivity; a pure function of the arguments."""
    sampled = sample_variation(settings, seeds)
    if not sampled:
        return face
    mesh = face.mesh
    fields = _fields(mesh.vertices_mm, getattr(seeds, settings.per))
    warp_mm = np.float32(sampled["variation.shape_mm"]) * fields[:, :3]
    albedo = np.float32(SKIN_ALBEDO) if mesh.albedo is None else mesh.albedo
    albedo = albedo * np.exp(np.float32(sampled["variation.albedo"]) * fields[:, 3])
    albedo = np.clip(albedo, _MIN_ALBEDO, _MAX_ALBEDO)
    varied = replace(mesh, vertices_mm=mesh.vertices_mm + warp_mm, albedo=albedo)
    return replace(face, mesh=varied)


def _fields(points_mm: NDArray[np.float32], seed: int) -> NDArray[np.float32]:
    """Return random fields (V, 4) float32 of variance 1: a warp (x, y, z), and a log albedo."""
    rng = keyed_rng(seed, 0xFACE)
    length_mm = np.repeat(_WAVELENGTHS_MM, _WAVES)
    wave = rng.standard_normal((3, len(length_mm)))
    wave *= 2 * np.pi / (length_mm * np.linalg.norm(wave, axis=0))
    phase = rng.uniform(0, 2 * np.pi, len(length_mm))
    amplitude = rng.standard_normal((len(length_mm), 4))
    amplitude[:, :3] *= length_mm[:, None]
    # A wave's mean square is half the square of its amplitude.
    amplitude *= np.sqrt(2 / np.array([*[np.sum(length_mm**2)] * 3, len(length_mm)]))
    # By columns, (waves, V): NumPy is fast along the last axis.
    shift = phase[:, None].astype(np.float32)
    waves = np.cos(product(wave.T.astype(np.float32), points_mm.T) + shift)
    return np.ascontiguousarray(product(amplitude.T.astype(np.float32), waves).T)
