"""The sheet of the Azure Kinect: infrared, its limits, the range, and Microsoft's errors."""

from __future__ import annotations

import numpy as np

from glsim.validate import scenes
from glsim.validate.captures import Captures
from glsim.validate.report import Band, Check, Measurement, validation_check
from glsim.validate.sources import AZURE, MICROSOFT

_SHEET = "azure-kinect"
#: Distance of the wall whose infrared grows from left to right, mm.
_RAMP_MM = 1000.0


@validation_check(
    _SHEET,
    Check("9", "infrared of a white wall times the square of its distance in m",
          (Band("counts m^2", 1300, 1500),), AZURE, "measured"),
    Check("10", "brightest infrared with depth; infrared and valid pixels beyond",
          (Band("brightest", 14_000, 18_000, "counts"), Band("infrared", 65535, 65535, "counts"),
           Band("valid", 0, 0)), AZURE, "measured"),
    Check("11", "infrared at which half of the pixels have depth",
          (Band("counts", 40, 65, "counts"),), AZURE, "measured"),
    Check("12", "nearest depth, and the share of pixels with depth at 3.8 m and at 4 m",
          (Band("nearest", 150, 170, "mm", "measured"), Band("3.8 m", 0.95, 1), Band("4 m", 0, 0)),
          f"{AZURE}; {MICROSOFT}", "datasheet"),
    Check("13", "mean error at 0.5, 1, 2 and 3 m, less 0.1 % of the distance",
          tuple(Band(f"{z} m", 0, 11, "mm") for z in (0.5, 1, 2, 3)), MICROSOFT, "datasheet"),
    Check("14", "temporal noise of a white wall at 1, 2 and 3 m",
          tuple(Band(f"{z} m", 0, 17, "mm") for z in (1, 2, 3)), MICROSOFT, "datasheet"),
)  # fmt: skip
def limits(captures: Captures) -> dict[str, Measurement]:
    """Measure walls, one whose albedo grows, and one nearer than the range."""
    wall = captures.wall(1500.0, 0.8)
    bright = captures.camera.capture(
        scenes.wall(200.0, 0.8), 1, at_mm=(0, 0, 200.0), scene="bright"
    ).centre()
    ramp = scenes.albedo_ramp(330.0, 100.0, 0.5, 1.4)
    steep = captures.camera.capture(ramp, 4, None, scene="steep ramp")
    valid = np.isfinite(steep.frames_mm)
    dim = captures.camera.capture(
        scenes.albedo_ramp(_RAMP_MM, 500.0, 0.0, 0.1), 8, None, scene="dim ramp"
    )
    near = [z for z in range(140, 200, 5) if _share(captures, float(z), 0.1) > 0.5]
    share = {f"{z} m": abs(captures.mean_error_mm(1000.0 * z)) - z for z in (0.5, 1, 2, 3)}
    noise = {f"{z} m": captures.temporal_sigma_mm(1000.0 * z) for z in (1, 2, 3)}
    return {
        "9": Measurement({"counts m^2": float(wall.infrared.mean()) * 1.5**2}),
        "10": Measurement(
            {
                "brightest": float(np.percentile(steep.infrared[valid], 99.99)),
                "infrared": float(np.median(bright.infrared)),
                "valid": float(np.isfinite(bright.frames_mm).mean()),
            }
        ),
        "11": Measurement({"counts": _half_valid(dim.infrared, np.isfinite(dim.frames_mm))}),
        "12": Measurement(
            {
                "nearest": float(min(near)) if near else None,
                "3.8 m": _share(captures, 3800.0, 0.8),
                "4 m": _share(captures, 4000.0, 0.8),
            }
        ),
        "13": Measurement({k: max(v, 0.0) for k, v in share.items()}, note="of one device"),
        "14": Measurement(noise),
    }


def _share(captures: Captures, z_mm: float, albedo: float) -> float:
    """Return the share of pixels with depth in the middle of a wall."""
    return float(np.isfinite(captures.wall(z_mm, albedo).frames_mm).mean())


def _half_valid(infrared: np.ndarray, valid: np.ndarray) -> float:
    """Return the infrared, counts, below which fewer than half of the pixels have depth."""
    edges = np.arange(20, 140, 4)
    bins = np.digitize(infrared.ravel(), edges)
    shares = [valid.ravel()[bins == k].mean() for k in range(1, len(edges))]
    least = next((k for k, share in enumerate(shares) if share >= 0.5), None)
    return float("nan") if least is None else float(edges[least] + 2)
