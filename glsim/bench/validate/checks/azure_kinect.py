"""The sheet of the Azure Kinect: rows measured on its one real frame, and by Microsoft.

The frame is pyk4a's test recording, NFOV unbinned (docs/time_of_flight.md). tests/bench holds
the bands against that frame with the same code.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from glsim.bench.measures.rims import find_rims
from glsim.bench.measures.tiles import LAGS_PX, WIDE_PX, plane_tiles
from glsim.bench.validate import scenes
from glsim.bench.validate.captures import Captures
from glsim.bench.validate.report import Measurement, validation_check
from glsim.core.depth_frame import Frames

_SHEET = "azure-kinect"

#: Limits of the bins of infrared, counts, in which noise is compared.
COUNTS = (60, 100, 150, 200, 300, 500, 1000, 3000, 9000)
#: Infrared of the tiles whose noise's correlation is measured, counts: noise is largest there.
DIM = (60.0, 200.0)
#: Rims of the mug and its handle before the walls, mm: depth of foreground and background.
MUG_MM, BEHIND_MM = 330.0, 1300.0
#: Distance of the wall whose infrared grows from left to right, mm.
_RAMP_MM = 1000.0


def noise_law_mm(counts: float) -> float:
    """Return the plane residual of the real frame over infrared, mm (measured, within 12 %)."""
    return float(np.hypot(0.42, 84 / counts**0.75))


def _frame(capture: Frames) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
    """Return depth, mm, and infrared of the first frame."""
    return np.nan_to_num(capture.whole_mm[0]), capture.stack("infrared")[0]


@validation_check(_SHEET)
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


@validation_check(_SHEET)
def rims(captures: Captures) -> dict[str, Measurement]:
    """Measure a bar's shadow, and the rims of a mug before walls."""
    camera = captures.camera
    bar = scenes.rectangle((-10, 10), (-300, 300), 297.0, 0.3)
    scene = scenes.merge_meshes(bar, scenes.wall(1520.0, 0.8))
    shot = camera.capture(scene, 1, None, scene="bar", extra=("lit",))
    row = camera.rig.intrinsics.height // 2
    clean, lit = shot.truth_mm[row], shot.stack("lit")[0, row].reshape(-1)
    front, back = np.flatnonzero(clean < 1000), clean > 1000
    shadow = np.flatnonzero(back & (lit < 0.5))
    shift = float(shadow.max() - front.max()) if shadow.size else 0.0
    penumbra = float((back & (lit > 0) & (lit < 1)).sum())
    depth, _ = _frame(camera.capture(scenes.mug_before_walls(), 1, None, scene="mug"))
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


@validation_check(_SHEET)
def limits(captures: Captures) -> dict[str, Measurement]:
    """Measure walls, one whose albedo grows, and one nearer than the range."""
    wall = captures.wall(1500.0, 0.8)
    bright = captures.camera.capture(
        scenes.wall(200.0, 0.8), 1, at_mm=(0, 0, 200.0), scene="bright"
    ).centre()
    ramp = scenes.albedo_ramp(330.0, 100.0, 0.5, 1.4)
    steep = captures.camera.capture(ramp, 4, None, scene="steep ramp")
    valid = np.isfinite(steep.whole_mm)
    dim = captures.camera.capture(
        scenes.albedo_ramp(_RAMP_MM, 500.0, 0.0, 0.1), 8, None, scene="dim ramp"
    )
    near = [z for z in range(140, 200, 5) if _share(captures, float(z), 0.1) > 0.5]
    share = {f"{z} m": abs(captures.mean_error_mm(1000.0 * z)) - z for z in (0.5, 1, 2, 3)}
    noise = {f"{z} m": captures.temporal_sigma_mm(1000.0 * z) for z in (1, 2, 3)}
    return {
        "9": Measurement({"counts m^2": float(wall.stack("infrared").mean()) * 1.5**2}),
        "10": Measurement(
            {
                "brightest": float(np.percentile(steep.stack("infrared")[valid], 99.99)),
                "infrared": float(np.median(bright.stack("infrared"))),
                "valid": float(np.isfinite(bright.whole_mm).mean()),
            }
        ),
        "11": Measurement(
            {"counts": _half_valid(dim.stack("infrared"), np.isfinite(dim.whole_mm))}
        ),
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
    return float(np.isfinite(captures.wall(z_mm, albedo).whole_mm).mean())


def _half_valid(infrared: np.ndarray, valid: np.ndarray) -> float:
    """Return the infrared, counts, below which fewer than half of the pixels have depth."""
    edges = np.arange(20, 140, 4)
    bins = np.digitize(infrared.ravel(), edges)
    shares = [valid.ravel()[bins == k].mean() for k in range(1, len(edges))]
    least = next((k for k, share in enumerate(shares) if share >= 0.5), None)
    return float("nan") if least is None else float(edges[least] + 2)
