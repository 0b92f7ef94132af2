"""Checks of the structured-light sensors: kinect-v1 and kinect-v2-paper."""

from __future__ import annotations

import numpy as np

from glsim.validate import measure, scenes
from glsim.validate.bench import Changes
from glsim.validate.edges import NEAR_MM, step
from glsim.validate.lab import Lab
from glsim.validate.measure import Array
from glsim.validate.report import Measured
from glsim.validate.sheet_structured import SHADOW_M, V1_DISTANCES_MM

_OFF = {"enabled": 0.0}
_ON = {"enabled": 1.0}


def disparity_px(lab: Lab, depth_mm: Array) -> Array:
    """Focal length times baseline over depth."""
    return np.asarray(1000.0 * lab.bench.rig.intrinsics.fx * lab.bench.rig.baseline_m / depth_mm)


def v1_noise(lab: Lab) -> dict[str, Measured]:
    """Checks 1 to 3 of kinect-v1."""
    sigma = {z: lab.sigma_s(z) for z in V1_DISTANCES_MM}
    jitter = measure.edge_jitter(measure.edge_positions(step(lab, 1500).frames_mm, NEAR_MM, 1500))
    return {
        "1": Measured({f"{z / 1000:g} m": s for z, s in sigma.items()},
                      "rounding to 1/8 px is part of it"),
        "2": Measured({"ratio": measure.ratio(sigma[4000], sigma[2000])}),
        "3": Measured({"std": jitter}),
    }  # fmt: skip


def v1_steps(lab: Lab) -> dict[str, Measured]:
    """Checks 4, 5 and 9 of kinect-v1: what disparity in 1/8 px does to depth."""
    on_grid, steps = [], {}
    for z in V1_DISTANCES_MM:
        depth = lab.wall(z).frames_mm
        depth = depth[np.isfinite(depth)]
        eighths = 8.0 * disparity_px(lab, depth)
        # Half a mm of rounding, in eighths of a pixel.
        tolerance = 0.51 * eighths / depth
        on_grid.append(np.abs(eighths - np.rint(eighths)) <= tolerance)
        steps[f"{z / 1000:g} m"] = _mean_step(lab, z)
    ramp = lab.bench.shoot(
        scenes.ten_centimetres(lab.bench.rig.intrinsics.fx), crop=96, scene="ramp"
    )
    return {
        "4": Measured({"share": 100.0 * float(np.concatenate(on_grid).mean())}),
        "5": Measured(steps),
        "9": Measured({"levels": float(scenes.levels_on_ramp(ramp.encoded))}),
    }


def _mean_step(lab: Lab, z_mm: float) -> float:
    """Mean difference of neighbouring levels of depth on a ramp through 6 % of z to both sides."""
    half_x = 40 * z_mm / lab.bench.rig.intrinsics.fx
    shots = lab.bench.shoot(
        scenes.depth_ramp(z_mm, half_x, 0.09 * z_mm), 16, at_mm=(0, 0, z_mm), scene=f"ramp {z_mm}"
    )
    levels = np.unique(shots.encoded).astype(np.float64)
    levels = levels[np.abs(levels / z_mm - 1.0) < 0.06]
    return float(np.diff(levels).mean()) if levels.size > 1 else float("nan")


def v1_range(lab: Lab) -> dict[str, Measured]:
    """Checks 7 and 8 of kinect-v1."""
    image = lab.bench.rig.intrinsics
    across = 2 * np.degrees(np.arctan(image.width / 2 / image.fx))
    down = 2 * np.degrees(np.arctan(image.height / 2 / image.fy))
    return {
        "7": _range(lab, (500, 680, 6500), (730, 2000, 5500)),
        "8": Measured({"across": float(across), "down": float(down)}),
    }


def v1_shadow(lab: Lab) -> dict[str, Measured]:
    """Check 6 of kinect-v1."""
    return {"6": _shadow(lab, {"edge_dropout": _OFF, "lateral": _OFF, "despeckle": _OFF})}


def paper_noise(lab: Lab) -> dict[str, Measured]:
    """Checks 1 to 5 of kinect-v2-paper: noise in disparity on a wall at 0.9 m."""

    def disparity(changes: Changes) -> Array:
        return disparity_px(lab, lab.wall(900, changes=changes).fine_mm)

    still = measure.mean_of(disparity({"perlin": _OFF}))
    shipped = disparity({})
    eighths = 8.0 * shipped[np.isfinite(shipped)]
    moved = shipped - still
    doubled = disparity({"perlin": {"amplitude_px": 0.8}}) - still
    gaussian = disparity({"perlin": _OFF, "gaussian": _ON})
    simplex = disparity({"perlin": _OFF, "simplex": _ON}) - still
    rms = [np.sqrt(measure.mean_of(field**2) - 0.125**2 / 12) for field in (moved, doubled)]
    smooth = measure.autocorrelation(moved - measure.mean_of(moved), [(0, 8)])
    return {
        "1": Measured({"share": 100.0 * float((np.abs(eighths - np.rint(eighths)) < 0.01).mean())}),
        "2": Measured({"largest": float(np.nanmax(np.abs(moved))), "doubled": rms[1] / rms[0]}),
        "3": Measured({"sigma": float(np.nanstd(gaussian))}),
        "4": Measured({"largest": float(np.nanmax(np.abs(simplex)))}),
        "5": Measured({"lag 8": float(smooth[0])}),
    }


def paper_window(lab: Lab) -> dict[str, Measured]:
    """Checks 6 and 7 of kinect-v2-paper, without noise."""
    pixel_mm = 900 / lab.bench.rig.intrinsics.fx
    quiet: Changes = {"perlin": _OFF}
    widths = np.arange(2.0, 13.0)
    seen = []
    for width in widths:
        half = 0.5 * width * pixel_mm
        shots = lab.bench.shoot(
            scenes.rectangle((-half, half), (-150, 150), 900), 1, 72, at_mm=(0, 0, 900),
            changes=quiet, scene="strip",
        )  # fmt: skip
        seen.append(np.isfinite(shots.centre(2, 64).frames_mm).mean())
    dots = lab.bench.shoot(
        scenes.wall(900), 1, None, at_mm=(0, 0, 900), scene="dots",
        changes={**quiet, "dot_spread": {"radius_px": 0.5}},
    ).centre(400)  # fmt: skip
    half = 30 * pixel_mm
    patch = lab.bench.shoot(
        scenes.rectangle((-half, half), (-half, half), 900), 1, 96, at_mm=(0, 0, 900),
        changes=quiet, scene="patch",
    )  # fmt: skip
    grown = np.isfinite(patch.frames_mm[0])
    return {
        "6": Measured({"width": measure.crossing(widths, np.array(seen), 0.5)}),
        "7": Measured({"share": float(np.isfinite(dots.frames_mm).mean()),
                       "reach": _reach(grown, np.isfinite(patch.clean_mm))}),
    }  # fmt: skip


def paper_geometry(lab: Lab) -> dict[str, Measured]:
    """Checks 8 to 10 of kinect-v2-paper."""
    return {
        "8": _shadow(lab, {"perlin": _OFF, "dot_spread": _OFF}),
        "9": _range(lab, (300, 470, 8000), (530, 2000, 5000)),
        "10": Measured({"baseline": 1000.0 * lab.bench.rig.baseline_m}),
    }


def _reach(grown: np.ndarray, clean: np.ndarray) -> float:
    """The largest distance from a grown pixel to the nearest clean one, pixels."""
    new, old = np.argwhere(grown & ~clean), np.argwhere(clean)
    if len(new) == 0 or len(old) == 0:
        return 0.0
    squared = ((new[:, None, :] - old[None, :, :]) ** 2).sum(axis=-1).min(axis=1)
    return float(np.sqrt(squared.max()))


def _range(lab: Lab, outside: tuple[float, ...], inside: tuple[float, ...]) -> Measured:
    def valid(z: float) -> float:
        shots = lab.bench.shoot(scenes.wall(z), 8, 24, at_mm=(0, 0, z), scene=f"range {z}")
        return 100.0 * float(np.isfinite(shots.frames_mm).mean())

    return Measured({"outside": max(map(valid, outside)), "inside": min(map(valid, inside))})


def _shadow(lab: Lab, changes: Changes) -> Measured:
    """Widths of the holes around a square at 0.9 m, without what else makes holes at edges."""
    half = 20.0 * NEAR_MM / lab.bench.rig.intrinsics.fx
    found: dict[str, float] = {}
    others: list[float] = []
    for far in SHADOW_M:
        shots = lab.bench.shoot(
            scenes.occluder(NEAR_MM, 1000 * far, half), 8, 144, at_mm=(0, 0, NEAR_MM),
            changes=changes, scene=f"hole {far}",
        )  # fmt: skip
        hole = np.isnan(shots.frames_mm).mean(axis=0)
        middle = slice(72 - 10, 72 + 10)
        across, down = hole[middle].mean(axis=0), hole[:, middle].mean(axis=1)
        found[f"{far:g} m"] = float(across[:72].sum())
        others += [float(across[72:].sum()), float(down[:72].sum()), float(down[72:].sum())]
    found["other sides"] = max(others, key=abs)
    return Measured(found)
