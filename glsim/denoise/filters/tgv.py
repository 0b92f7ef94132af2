"""Total generalised variation of second order on valid pixels.

K. Bredies, K. Kunisch, T. Pock, "Total Generalized Variation", SIAM J. Imaging Sciences 3 (2010):
minimise over the depth u and its slopes w

    sum of weight (u - noisy)^2 / 2 + alpha_1 |grad u - w| + alpha_0 |E w|

where E is the symmetrised gradient. Planes and the steps between them cost nothing or little, so
the result is piecewise smooth in slope. Solved by the primal-dual method of A. Chambolle and
T. Pock (J. Mathematical Imaging and Vision 40, 2011). Written after the papers.

Differences are taken between pixels of one surface only: holes and silhouettes have no influence.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np

from glsim.core.array_types import Depth, Floats, Mask
from glsim.core.depth_map import JUMP_MM, NEIGHBOURS
from glsim.denoise.filters.masked import Masked
from glsim.denoise.filters.windows import fill
from glsim.denoise.parameters import parameter
from glsim.networks.safeguards import estimate_noise_mm, local_noise_mm

#: Step of the primal and dual updates: their product is at most 1 / |K|^2, and |K|^2 <= 12 for
#: gradients and symmetrised gradients of step 1 px (Bredies 2014, section 4).
_STEP: Final = np.float32(1 / np.sqrt(12))
#: Smallest and largest weight of a pixel's depth: its noise is three times the frame's noise, or a
#: third of it. Both were chosen, not measured.
_WEIGHTS: Final = (1 / 9, 9.0)
#: Noise of frames with too little surface for an estimate; smallest noise, mm. Chosen.
_USUAL_MM, _LEAST_MM = 2.0, 0.01


@dataclass(frozen=True)
class TotalGeneralisedVariation(Masked):
    """Second-order total generalised variation (Bredies et al. 2010), weighted by local noise."""

    alpha: float = parameter(2.0, 0.01, 100, "weight of the slopes' misfit, in units of the noise")
    ratio: float = parameter(2.0, 0.1, 10, "weight of bends relative to that of the slopes' misfit")
    iterations: int = parameter(200, 10, 5000, "primal-dual iterations")

    def estimate(self, noisy_mm: Depth, support: Mask, wanted: Mask) -> Depth:
        """Compute smoothed depths; wanted pixels without support continue their surface."""
        filled = fill(noisy_mm, support)
        noise_mm = max(estimate_noise_mm(np.where(support, noisy_mm, 0)) or _USUAL_MM, _LEAST_MM)
        local_mm = local_noise_mm(np.where(support, noisy_mm, np.float32(0)), noise_mm)
        weight = np.clip((np.float32(noise_mm) / local_mm) ** 2, *_WEIGHTS).astype(np.float32)
        centre = np.float32(np.median(noisy_mm[support]))
        scale = np.float32(noise_mm)
        smooth = solve(
            (filled - centre) / scale, np.where(support, weight, np.float32(0)),
            SurfaceGradients(filled, wanted | support), np.float32(self.alpha),
            np.float32(self.ratio * self.alpha), self.iterations,
        )  # fmt: skip
        return np.asarray(np.maximum(smooth[wanted] * scale + centre, np.float32(0)))


class SurfaceGradients:
    """Finite differences between neighbouring pixels of one surface, and their adjoint operators.

    Arrays are (H, W) float32; the last column or row of a difference is 0.
    """

    def __init__(self, depth_mm: Depth, domain: Mask) -> None:
        """Link neighbouring pixels of ``domain`` whose depths differ by at most JUMP_MM."""
        self.across = np.zeros(depth_mm.shape, np.float32)
        self.down = np.zeros(depth_mm.shape, np.float32)
        for links, axis in ((self.across, 1), (self.down, 0)):
            near, far = NEIGHBOURS[axis]
            same = np.abs(np.diff(depth_mm, axis=axis)) <= JUMP_MM
            links[near] = domain[near] & domain[far] & same
        # A slope is compared with its neighbour where both links exist.
        self._across_across = _both(self.across, 1)
        self._across_down = _both(self.across, 0)
        self._down_down = _both(self.down, 0)
        self._down_across = _both(self.down, 1)
        self._mixed = self._across_down * self._down_across

    def gradient(self, u: Floats) -> tuple[Floats, Floats]:
        """Compute the forward differences across and down."""
        return _forward(u, 1) * self.across, _forward(u, 0) * self.down

    def gradient_adjoint(self, p: Floats, q: Floats) -> Floats:
        """Apply the adjoint of ``gradient``, the negative divergence."""
        return _forward_adjoint(p * self.across, 1) + _forward_adjoint(q * self.down, 0)

    def symmetrised(self, w: Floats, v: Floats) -> tuple[Floats, Floats, Floats]:
        """Compute the symmetrised gradient xx, yy, xy of the slopes across (w) and down (v)."""
        mixed = (_backward(w, 0) + _backward(v, 1)) * self._mixed
        return (
            _backward(w, 1) * self._across_across,
            _backward(v, 0) * self._down_down,
            np.float32(0.5) * mixed,
        )

    def symmetrised_adjoint(self, xx: Floats, yy: Floats, xy: Floats) -> tuple[Floats, Floats]:
        """Apply the adjoint of ``symmetrised``; xy counts twice in the norm."""
        mixed = xy * self._mixed
        w = _backward_adjoint(xx * self._across_across, 1) + _backward_adjoint(mixed, 0)
        v = _backward_adjoint(yy * self._down_down, 0) + _backward_adjoint(mixed, 1)
        return w, v


def solve(
    noisy: Floats, weight: Floats, on: SurfaceGradients, alpha_1: np.float32, alpha_0: np.float32,
    iterations: int,
) -> Floats:  # fmt: skip
    """Minimise the total generalised variation by a primal-dual method; return u, (H, W) float32.

    Args:
        noisy: (H, W) noisy depth, from which the iteration starts.
        weight: (H, W) weight of each pixel's depth; 0 without depth.
        alpha_1: weight of the slopes' misfit.
        alpha_0: weight of bends.
    """
    u, w, v = noisy.copy(), *on.gradient(noisy)
    w, v = (np.asarray(cv2.blur(part, (5, 5)), np.float32) for part in (w, v))
    u_bar, w_bar, v_bar = u, w, v
    p, q, xx, yy, xy = (np.zeros_like(noisy) for _ in range(5))
    pull = _STEP * weight
    for _ in range(iterations):
        across, down = on.gradient(u_bar)
        p += _STEP * (across - w_bar * on.across)
        q += _STEP * (down - v_bar * on.down)
        _project(alpha_1, p, q)
        d_xx, d_yy, d_xy = on.symmetrised(w_bar, v_bar)
        xx += _STEP * d_xx
        yy += _STEP * d_yy
        xy += _STEP * d_xy
        _project(alpha_0, xx, yy, xy, xy)
        u_next = u - _STEP * on.gradient_adjoint(p, q)
        u_next = (u_next + pull * noisy) / (1 + pull)
        w_pull, v_pull = on.symmetrised_adjoint(xx, yy, xy)
        w_next = w + _STEP * (p * on.across - w_pull)
        v_next = v + _STEP * (q * on.down - v_pull)
        u_bar, w_bar, v_bar = 2 * u_next - u, 2 * w_next - w, 2 * v_next - v
        u, w, v = u_next, w_next, v_next
    return np.asarray(u, np.float32)


def _project(radius: np.float32, *parts: Floats) -> None:
    """Project vectors, one component per array, onto the ball of a radius, in place."""
    size = np.sqrt(sum(part * part for part in parts))
    over = np.maximum(np.float32(1), size / radius)
    for part in {id(part): part for part in parts}.values():
        part /= over


def _forward(image: Floats, axis: int) -> Floats:
    """Compute the differences to the next pixel along an axis; 0 at the last pixel."""
    result, (near, far) = np.zeros_like(image), NEIGHBOURS[axis]
    np.subtract(image[far], image[near], out=result[near])
    return result


def _forward_adjoint(image: Floats, axis: int) -> Floats:
    """Apply the adjoint of ``_forward`` to an image that is 0 at its last pixels."""
    result, (near, far) = -image, NEIGHBOURS[axis]
    result[far] += image[near]
    return result


def _backward(image: Floats, axis: int) -> Floats:
    """Compute the differences to the pixel before along an axis; 0 at the first pixel."""
    result, (near, far) = np.zeros_like(image), NEIGHBOURS[axis]
    np.subtract(image[far], image[near], out=result[far])
    return result


def _backward_adjoint(image: Floats, axis: int) -> Floats:
    """Apply the adjoint of ``_backward`` to an image that is 0 at its first pixels."""
    result, (near, far) = image.copy(), NEIGHBOURS[axis]
    result[near] -= image[far]
    return result


def _both(links: Floats, axis: int) -> Floats:
    """Return 1 where a pixel and the pixel before it along an axis both have a link, else 0."""
    result, (near, far) = np.zeros_like(links), NEIGHBOURS[axis]
    result[far] = links[far] * links[near]
    return result


FILTERS = {"tgv": TotalGeneralisedVariation}
GRIDS = {"tgv": {"alpha": (1.0, 1.4, 2.0, 3.0, 4.5, 6.5), "ratio": (0.5, 1.0, 2.0)}}
