"""Calibration subtracts what denoisers do not remove: fixed pattern and measured wiggling."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Depth
from glsim.core.camera import Intrinsics
from glsim.core.errors import ConfigError
from glsim.sensors.images import remove_fixed_pattern
from glsim.sensors.sensor import load_sensor
from glsim.sensors.wiggling import remove_wiggling

#: Tolerance of a crop's position, px, since files have principal points as float32.
_CROP_PX: Final = 0.02
#: Largest relative difference between two focal lengths of the same camera. Chosen, not measured.
_SAME_FOCAL: Final = 1e-3


class DeviceCalibration:
    """The measured systematic errors of a device; ``parts`` lists the kinds of errors."""

    def __init__(self, file: Path | str) -> None:
        """Load a sensor file with a fixed pattern, wiggling, or both; ConfigError without them."""
        self.file = Path(file)
        if self.file.suffix != ".toml":
            raise ConfigError(f"--device {file}: give the sensor file (.toml) that glsim fit wrote")
        sensor = load_sensor(str(file))
        self._rig, self._pattern, self._waves = sensor.rig, sensor.pattern_map, sensor.wiggling
        found = {"fixed pattern": self._pattern is not None, "wiggling": bool(self._waves)}
        self.parts = tuple(name for name, known in found.items() if known)
        if not self.parts:
            raise ConfigError(
                f"--device {file}: holds neither a map of the fixed pattern "
                "(rig.fixed_pattern_map) nor measured wiggling (rig.wiggling): fit it to at least "
                "10 frames of walls with glsim fit"
            )
        pattern = "" if self._pattern is None else self._pattern.digest
        #: A text that changes with the subtracted errors.
        self.identity = f"{pattern} {self._waves!r} {self._rig!r}"

    def __call__(self, depth_mm: NDArray[Any], crop: Intrinsics | None = None) -> Depth:
        """Subtract the device's systematic errors from a map, (H, W) mm; 0 stays 0.

        ``crop`` is the intrinsics of a crop. Raises ConfigError for a map of another camera.
        """
        top, left = self._corner(depth_mm.shape, crop)
        height, width = depth_mm.shape
        part = np.s_[top : top + height, left : left + width]
        result = np.asarray(depth_mm, np.float32)
        if self._pattern is not None:
            result = remove_fixed_pattern(result, self._pattern.values[part])
        if self._waves:
            rig = self._rig
            result = remove_wiggling(
                result, self._waves, rig.modulation_mhz, rig.rays()[part], rig.emitter_m
            )
        # A valid depth stays at least 1 mm.
        return np.where(depth_mm > 0, np.maximum(result, np.float32(1.0)), 0).astype(np.float32)

    def _corner(self, shape: tuple[int, ...], crop: Intrinsics | None) -> tuple[int, int]:
        """Return row and column of a map in the device's image. Raises ConfigError."""
        own = self._rig.intrinsics
        size, whole = f"{shape[1]}x{shape[0]}", f"{own.width}x{own.height}"
        if crop is None:
            if shape != (own.height, own.width):
                raise ConfigError(
                    f"--device {self.file}: a map is {size}, the device's image {whole}: give "
                    "whole images, or crops in a data set of glsim, whose intrinsics say where "
                    "they lie (in Python: intrinsics=)"
                )
            return 0, 0
        left, top = own.cx - crop.cx, own.cy - crop.cy
        column, row = round(left), round(top)
        other_focal = max(abs(crop.fx - own.fx), abs(crop.fy - own.fy)) > _SAME_FOCAL * own.fx
        inside = 0 <= column <= own.width - shape[1] and 0 <= row <= own.height - shape[0]
        if other_focal or max(abs(left - column), abs(top - row)) > _CROP_PX or not inside:
            raise ConfigError(
                f"--device {self.file}: a map of {size} with a focal length of {crop.fx:.5g} px at "
                f"column {left:.5g}, row {top:.5g} is no crop of the device's {whole}, "
                f"{own.fx:.5g} px: these are maps of another camera"
            )
        return row, column
