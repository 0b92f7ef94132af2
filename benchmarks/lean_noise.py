"""The noise of kinect-v2-paper as a good user of NumPy and OpenCV writes it.

float32, the whole frame at once, everything that does not change made beforehand. Perlin noise has
one octave instead of six, the correlation window asks for its share of pixels only, and the dots of
the projector are left out: less than the sensor does. The sources of the numbers are in
``glsim/sensors/kinect-v2-paper.toml``.
"""

import cv2
import numpy as np

from glsim.core.array_types import Floats
from glsim.core.camera import SensorRig

_CELLS_X, _CELLS_Y = 4 / 1.5, 2 / 1.5
_AMPLITUDE_PX, _STEP_PX, _WINDOW_PX, _LEAST_SHARE = 0.4, 0.125, 9, 2 / 3
_NEAR_M, _FAR_M = 0.5, 6.0


class LeanNoise:
    """Adds noise to depth, m, where the emitter lights a share of each pixel; (H, W) float32."""

    def __init__(self, rig: SensorRig) -> None:
        image = rig.intrinsics
        self._focal_baseline = np.float32(image.fx * rig.baseline_m)
        x = np.arange(image.width, dtype=np.float32) * np.float32(_CELLS_X / image.width)
        y = np.arange(image.height, dtype=np.float32) * np.float32(_CELLS_Y / image.height)
        self._column, self._row = x.astype(np.int32), y.astype(np.int32)
        self._x, self._y = x - self._column, (y - self._row)[:, None]
        self._fade_x, self._fade_y = (
            t * t * t * (t * (t * 6 - 15) + 10) for t in (self._x, self._y)
        )

    def __call__(self, clean_m: Floats, lit: Floats, seed: int) -> Floats:
        """Draw the noise of one frame."""
        with np.errstate(divide="ignore"):
            disparity = self._focal_baseline / clean_m  # inf where there is no surface
        seen = (clean_m > 0) & (lit > 0.5)
        share = cv2.blur(seen.astype(np.float32), (_WINDOW_PX, _WINDOW_PX))
        seen &= share > _LEAST_SHARE
        disparity += _AMPLITUDE_PX * self._perlin(np.random.default_rng(seed))
        disparity = np.round(disparity / _STEP_PX) * np.float32(_STEP_PX)
        noisy_m = self._focal_baseline / disparity
        seen &= (noisy_m > _NEAR_M) & (noisy_m < _FAR_M)
        return np.where(seen, noisy_m, np.float32(0))

    def _perlin(self, rng: np.random.Generator) -> Floats:
        """One octave of gradient noise, (H, W), about -0.7 to 0.7."""
        rows, columns = int(self._row[-1]) + 2, int(self._column[-1]) + 2
        angle = rng.uniform(0, 2 * np.pi, (rows, columns)).astype(np.float32)
        along_x, along_y = np.cos(angle), np.sin(angle)

        def corner(down: int, right: int) -> Floats:
            place = np.ix_(self._row + down, self._column + right)
            product: Floats = along_x[place] * (self._x - right) + along_y[place] * (self._y - down)
            return product

        def edge(down: int) -> Floats:
            left = corner(down, 0)
            between: Floats = left + self._fade_x * (corner(down, 1) - left)
            return between

        top = edge(0)
        noise: Floats = top + self._fade_y * (edge(1) - top)
        return noise
