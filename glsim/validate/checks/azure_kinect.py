"""The sheet of the Azure Kinect: rows measured on its one real frame, and by Microsoft.

The frame is pyk4a's test recording, NFOV unbinned (docs/time_of_flight.md). tests/validate holds
the bands against that frame with the same code.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from glsim.measures.rims import find_rims
from glsim.measures.tiles import LAGS_PX, WIDE_PX, plane_tiles
from glsim.validate import scenes
from glsim.validate.captures import Captures
from glsim.validate.mug_scene import mug_before_walls
from glsim.validate.report import Band, Check, Measurement, validation_check
from glsim.validate.sources import AZURE
from glsim.validate.virtual_camera import Capture

_SHEET = "azure-kinect"

#: Limits of the bins of infrared, counts, in which noise is compared.
COUNTS = (60, 100, 150, 200, 300, 500, 1000, 3000, 9000)
#: Infrared of the tiles whose noise's correlation is measured, counts: noise is largest there.
DIM = (60.0, 200.0)
#: Correlation of the real frame's noise in these tiles at LAGS_PX; bands allow 0.1 on either side.
REAL_CORRELATION = {"rows": (0.75, 0.57, 0.29, 0.11), "columns": (0.76, 0.58, 0.32, 0.15)}
#: Rims of the mug and its handle before the walls, mm: depth of foreground and background.
MUG_MM, BEHIND_MM = 330.0, 1300.0


def noise_law_mm(counts: float) -> float:
    """Return the plane residual of the real frame over infrared, mm (measured, within 12 %)."""
    return float(np.hypot(0.42, 84 / counts**0.75))


def _frame(capture: Capture) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Return depth, mm, and infrared of the first frame."""
    return np.nan_to_num(capture.frames_mm[0]), capture.infrared[0]


@validation_check(
    _SHEET,
    Check(
        "1", "plane residual over infrared, of the real frame's law: its share, 60 to 9,000 counts",
        tuple(Band(f"{a}-{b}", 0.85, 1.15) for a, b in pairwise(COUNTS)),
        AZURE, "measured",
    ),
    Check(
        "2", "correlation of the noise at 60 to 200 counts, 1 to 4 px along rows and columns",
        tuple(Band(f"{way} {lag}", round(real - 0.1, 2), round(real + 0.1, 2))
              for way, values in REAL_CORRELATION.items()
              for lag, real in zip(LAGS_PX, values, strict=True)),
        AZURE, "measured",
    ),
)  # fmt: skip
def noise(captures: Captures) -> dict[str, Measurement]:
    """Measure walls of many distances and albedos."""
    camera = captures.camera
    shots = [
        _frame(camera.capture(scenes.wall(z, a), 1, 160, at_mm=(0, 0, z), scene=f"{z} {a}"))
        for z in (300.0, 500.0, 800.0, 1200.0, 1600.0, 2000.0)
        for a in (0.05, 0.1, 0.2, 0.4, 0.8)
    ]
    tiles = [plane_tiles(depth, counts) for depth, counts in shots]
    every_count = np.concatenate([t.infrared for t in tiles])
    every_rms = np.concatenate([t.rms_mm for t in tiles])
    shares: dict[str, float | None] = {}
    for low, high in pairwise(COUNTS):
        inside = (every_count >= low) & (every_count < high)
        law = noise_law_mm(float(np.median(every_count[inside]))) if inside.any() else np.nan
        rms = float(np.median(every_rms[inside])) if inside.any() else np.nan
        shares[f"{low}-{high}"] = rms / law
    sums: dict[str, list[float]] = {}
    for depth, counts in shots:
        wide = plane_tiles(depth, counts, WIDE_PX)
        if ((wide.infrared >= DIM[0]) & (wide.infrared < DIM[1])).sum() < 20:
            continue
        for name, values in zip(("rows", "columns"), wide.correlation(*DIM), strict=True):
            for lag, value in zip(LAGS_PX, values, strict=True):
                sums.setdefault(f"{name} {lag}", []).append(value)
    correlation: dict[str, float | None] = {k: float(np.mean(v)) for k, v in sums.items()}
    return {
        "1": Measurement(shares),
        "2": Measurement(correlation, note="the real frame's holds bends of its surfaces too"),
    }


@validation_check(
    _SHEET,
    Check("3", "shadow of an edge at 0.297 m on a wall at 1.52 m, to the right",
          (Band("px", 18, 20, "px"),), AZURE, "measured"),
    Check("4", "penumbra of that shadow", (Band("px", 2, 8, "px"),), AZURE, "measured"),
    Check("5", "gaps beside the mug: the lit side, the shadow's",
          (Band("lit", 2, 4, "px"), Band("shadow", 11, 18, "px")), AZURE, "measured"),
    Check("6", "pixels between the surfaces, within 3 px of the mug's rims, rows",
          (Band("share", 0, 0.011),), AZURE, "measured"),
    Check("7", "bend of the mug's last pixel: median on the lit side, the shadow's; next pixel",
          (Band("lit", -17, -2, "mm"), Band("shadow", -12, 2, "mm"),
           Band("lit, next", -7, 1, "mm")),
          AZURE, "measured"),
    Check("8", "bend of the wall's first pixel: median by the shadow, next pixel, lit side",
          (Band("shadow", 2, 84, "mm"), Band("shadow, next", 2, 53, "mm"),
           Band("lit", 0, 17, "mm")),
          AZURE, "measured"),
)  # fmt: skip
def rims(captures: Captures) -> dict[str, Measurement]:
    """Measure a bar's shadow, and the rims of a mug before walls."""
    camera = captures.camera
    bar = scenes.rectangle((-10, 10), (-300, 300), 297.0, 0.3)
    scene = scenes.merge_meshes(bar, scenes.wall(1520.0, 0.8))
    shot = camera.capture(scene, 1, None, scene="bar", extra=("lit",))
    row = camera.rig.intrinsics.height // 2
    clean, lit = shot.clean_mm[row], shot.extra["lit"][0, row].reshape(-1)
    front, back = np.flatnonzero(clean < 1000), clean > 1000
    shadow = np.flatnonzero(back & (lit < 0.5))
    shift = float(shadow.max() - front.max()) if shadow.size else 0.0
    penumbra = float((back & (lit > 0) & (lit < 1)).sum())
    depth, _ = _frame(camera.capture(mug_before_walls(), 1, None, scene="mug"))
    return {
        "3": Measurement({"px": shift}),
        "4": Measurement({"px": penumbra}),
        **rim_measurements(depth),
    }


def rim_measurements(depth_mm: NDArray[np.floating]) -> dict[str, Measurement]:
    """Measure checks 5 to 8 on a frame of the mug, real or simulated.

    Args:
        depth_mm: (H, W) depth, mm; 0 where there is none.
    """
    found = find_rims(depth_mm)
    mug = found.where(found.front_mm < MUG_MM)
    lit, dark = mug.where(~mug.right), mug.where(mug.right & (mug.back_mm > BEHIND_MM))
    if min(len(lit.gap_px), len(dark.gap_px)) < 20:
        return {n: Measurement({}, note="too few rims") for n in ("5", "6", "7", "8")}

    def middle(values: NDArray[np.float64]) -> float:
        return float(np.median(values))

    return {
        "5": Measurement({"lit": middle(lit.gap_px), "shadow": middle(dark.gap_px)}),
        "6": Measurement({"share": mug.between_share}),
        "7": Measurement(
            {
                "lit": middle(lit.front_bend_mm[:, 0]),
                "shadow": middle(dark.front_bend_mm[:, 0]),
                "lit, next": middle(lit.front_bend_mm[:, 1]),
            }
        ),
        "8": Measurement(
            {
                "shadow": middle(dark.back_bend_mm[:, 0]),
                "shadow, next": middle(dark.back_bend_mm[:, 1]),
                "lit": middle(lit.back_bend_mm[:, 0]),
            }
        ),
    }
