"""Checks at depth edges: jitter, mixed pixels, silhouettes, shadows (15 to 21)."""

from __future__ import annotations

import numpy as np

from glsim.validate import measure, scenes
from glsim.validate.bench import Changes, Shots
from glsim.validate.curves import shadow_px
from glsim.validate.lab import INTERNAL, Lab
from glsim.validate.measure import Array
from glsim.validate.report import Measured

NEAR_MM = 900.0
_EDGE_PX = 96


def step(lab: Lab, far_mm: float, changes: Changes | None = None) -> Shots:
    """Frames of an edge at 0.9 m: 64 rows of it, in full light."""
    return lab.bench.shoot(
        scenes.step(NEAR_MM, far_mm), crop=_EDGE_PX, at_mm=(0, 0, NEAR_MM),
        changes=changes, scene=f"edge {far_mm}", frames=lab.many,
    ).centre(48, 64)  # fmt: skip


def mixed(lab: Lab) -> dict[str, Measured]:
    """Checks 15 to 18."""
    filtered = step(lab, 1500)
    on = measure.mixed_per_row(filtered.fine_mm, NEAR_MM, 1500)
    small = measure.mixed_per_row(step(lab, 950).fine_mm, NEAR_MM, 950)
    jitter = measure.edge_jitter(measure.edge_positions(filtered.frames_mm, NEAR_MM, 1500))
    found = {
        "15": Measured({"std": jitter}),
        "18": Measured({"0.95 m": small[2], "1.5 m": on[2]}),
    }
    off = lab.knobs.no_filters
    if off is None:
        return found | {n: Measured(why_not=INTERNAL) for n in ("16", "17")}
    raw = measure.mixed_per_row(step(lab, 1500, off).fine_mm, NEAR_MM, 1500)
    short = measure.mixed_per_row(step(lab, 2000, off).fine_mm, NEAR_MM, 2000)
    found["16"] = Measured({"off": raw[0], "off, outside": raw[1], "on": on[0]})
    found["17"] = Measured({"between": short[0], "outside": short[1]})
    return found


def silhouette(lab: Lab) -> dict[str, Measured]:
    """Check 19: a square before nothing. Growth a side is from the widths of its rows, columns."""
    changes = lab.knobs.no_filters
    half = 40.0 * NEAR_MM / lab.bench.rig.intrinsics.fx
    shots = lab.bench.shoot(
        scenes.rectangle((-half, half), (-half, half), NEAR_MM), crop=128,
        at_mm=(0, 0, NEAR_MM), changes=changes, scene="silhouette", frames=lab.many,
    )  # fmt: skip
    strays = np.abs(shots.fine_mm - NEAR_MM) > 30
    close = np.abs(shots.fine_mm - NEAR_MM) <= 30
    clean = np.isfinite(shots.clean_mm)
    middle = slice(64 - 24, 64 + 24)
    grown = []
    for axis in (1, 2):
        cut = (slice(None), slice(None), middle) if axis == 1 else (slice(None), middle)
        width = close[cut].sum(axis=axis) - clean[cut[1:]].sum(axis=axis - 1)
        grown.append(width.ravel() / 2.0)
    growth = np.concatenate(grown)
    extreme = float(growth.min() if -growth.min() > growth.max() else growth.max())
    return {
        "19": Measured(
            {
                "strays": float(strays.sum()) / len(strays),
                "growth": extreme,
                "mean growth": float(growth.mean()),
            },
            "" if changes is not None else "with all stages: this chain has no filters to leave out",
        )
    }


def shadow_profile(lab: Lab, far_mm: float, horizontal: bool = True) -> tuple[Array, Array, Shots]:
    """Pixels from the middle of a square at 0.9 m, and how light the background is there.

    Light is the infrared relative to the same wall alone, 0 to 1; NaN on the square.
    """
    half = 20.0 * NEAR_MM / lab.bench.rig.intrinsics.fx
    shots = lab.bench.shoot(
        scenes.occluder(NEAR_MM, far_mm, half), crop=128, at_mm=(0, 0, NEAR_MM),
        scene=f"shadow {far_mm}", frames=lab.many,
    )  # fmt: skip
    bare = lab.bench.shoot(
        scenes.wall(far_mm), 8, 128, at_mm=(0, 0, NEAR_MM), scene=f"unshadowed {far_mm}"
    )
    light = shots.infrared.mean(axis=0) / np.maximum(bare.infrared.mean(axis=0), 1.0)
    light = np.where(shots.clean_mm > far_mm - 1, light, np.nan)
    band = slice(64 - 10, 64 + 10)
    image = light[band] if horizontal else light[:, band].T
    profile = np.array([measure.mean_of(column) for column in image.T])
    return np.arange(128) - 63.5, profile, shots


def _darkness(place: Array, profile: Array) -> tuple[float, float]:
    """Full shadow widths on the negative and on the positive side: the light that lacks, in px.

    Beside the square itself its own light bleeds over (point spread); it is not counted.
    """
    lack = np.clip(1.0 - np.nan_to_num(profile, nan=1.0), 0.0, 1.0)
    lack = np.where(lack < 0.05, 0.0, lack)
    return float(lack[place < 0].sum()), float(lack[place > 0].sum())


def shadows(lab: Lab) -> dict[str, Measured]:
    """Checks 20 and 21."""
    found: dict[str, float] = {}
    others: list[float] = []
    for far in (1100, 1500, 2000):
        place, profile, _ = shadow_profile(lab, far)
        left, right = _darkness(place, profile)
        found[f"{far / 1000:g} m"] = left
        up, down = _darkness(*shadow_profile(lab, far, horizontal=False)[:2])
        others += [right, up, down]
    found["other sides"] = max(others, key=abs)
    return {"20": Measured(found, _expected(lab)), "21": _penumbra(lab)}


def _expected(lab: Lab) -> str:
    emitters = lab.bench.rig.emitters
    if not emitters:
        return "the rig has no emitter"
    baseline = float(np.mean([e.position_m[0] for e in emitters]))
    focal = lab.bench.rig.intrinsics.fx
    widths = (f"{shadow_px(baseline, focal, 0.9, z):.1f}" for z in (1.1, 1.5, 2.0))
    return f"b f (1/Zo - 1/Zb) of this rig: {', '.join(widths)} px; width is the light that lacks"


def _penumbra(lab: Lab) -> Measured:
    """Check 21: plateaus of light on the shadowed side of a square before a wall at 2 m."""
    place, profile, shots = shadow_profile(lab, 2000)
    side = (place < 0) & np.isfinite(profile)
    inner = np.flatnonzero(side & (profile > 0.15) & (profile < 0.85))
    # A plateau: a column whose neighbours are as light as itself.
    levels: list[float] = []
    columns: list[int] = []
    for column in inner:
        around = profile[column - 1 : column + 2]
        if np.isfinite(around).all() and np.ptp(around) < 0.12:
            if not levels or abs(profile[column] - levels[-1]) > 0.15:
                levels.append(float(profile[column]))
            columns.append(int(column))
    if not columns:
        return Measured({"levels": 0.0}, "light falls from full to none within a pixel or two")
    sigma = measure.sigma_temporal_map(shots.frames_mm[:, 54:74])
    lit = measure.mean_of(sigma[:, place > 40])
    growth = [measure.mean_of(sigma[:, column]) / lit for column in columns]
    shares = ", ".join(f"{level:.2f}" for level in levels)
    return Measured(
        {"levels": float(len(levels)), "sigma": float(np.nanmax(growth))}, f"levels {shares}"
    )
