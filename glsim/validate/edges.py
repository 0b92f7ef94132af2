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
#: The square that throws shadows: half its side; and the window around it.
HALF_PX = 20.0
_SHADOW_PX = 128


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
    off = lab.knobs.no_filters
    values = _silhouette(lab, off)
    if off is None:
        return {"19": Measured(values, "with all stages: this chain has no filters to leave out")}
    exception = ""
    if values["strays"] > 0 and lab.knobs.no_light_noise is not None:
        exact = _silhouette(lab, {**off, **lab.knobs.no_light_noise})
        if exact["strays"] == 0:
            exception = (
                "0 strays without noise of the light, so no mixed pixels: rims as dark as the "
                "thresholds of check 23 let pass (3 to 8) have more than 30 mm of raw noise by "
                "checks 9 and 10 (45 mm at 10)"
            )
    return {"19": Measured(values, exception=exception)}


def _silhouette(lab: Lab, changes: Changes | None) -> dict[str, float]:
    half = 40.0 * NEAR_MM / lab.bench.rig.intrinsics.fx
    shots = lab.bench.shoot(
        scenes.rectangle((-half, half), (-half, half), NEAR_MM), crop=128,
        at_mm=(0, 0, NEAR_MM), changes=changes, scene="silhouette", frames=lab.many,
    )  # fmt: skip
    away = np.abs(np.nan_to_num(shots.fine_mm, nan=NEAR_MM) - NEAR_MM)
    close = np.isfinite(shots.fine_mm) & (away <= 30)
    clean = np.isfinite(shots.clean_mm)
    middle = slice(64 - 24, 64 + 24)
    rows = close[:, middle].sum(axis=2) - clean[middle].sum(axis=1)
    columns = close[:, :, middle].sum(axis=1) - clean[:, middle].sum(axis=0)
    growth = np.concatenate([rows.ravel(), columns.ravel()]) / 2.0
    return {
        "strays": float((away > 30).sum()) / len(away),
        "growth": float(growth[np.abs(growth).argmax()]),
        "mean growth": float(growth.mean()),
    }


def shadow_profile(lab: Lab, far_mm: float, horizontal: bool = True) -> tuple[Array, Array, Shots]:
    """Pixels from the axis through a square of +-20 px at 0.9 m, and how light the background is.

    Light is the infrared relative to the same wall alone, 0 to 1; NaN on the square.
    """
    focal = lab.bench.rig.intrinsics.fx
    half = HALF_PX * NEAR_MM / focal
    shots = lab.bench.shoot(
        scenes.occluder(NEAR_MM, far_mm, half), crop=_SHADOW_PX, at_mm=(0, 0, NEAR_MM),
        scene=f"shadow {far_mm}", frames=lab.many,
    )  # fmt: skip
    bare = lab.bench.shoot(
        scenes.wall(far_mm), 8, _SHADOW_PX, at_mm=(0, 0, NEAR_MM), scene=f"unshadowed {far_mm}"
    )
    light = shots.infrared.mean(axis=0) / np.maximum(bare.infrared.mean(axis=0), 1.0)
    light = np.where(shots.clean_mm > far_mm - 1, light, np.nan)
    band = slice(_SHADOW_PX // 2 - 10, _SHADOW_PX // 2 + 10)
    image = light[band] if horizontal else light[:, band].T
    profile = np.array([measure.mean_of(column) for column in image.T])
    rays = shots.rays[0, :, 0] if horizontal else shots.rays[:, 0, 1]
    return np.asarray(rays * focal, np.float64), profile, shots


def shadow_of(lab: Lab, far_mm: float) -> tuple[Array, Array, Shots]:
    """The horizontal profile of ``shadow_profile``, taken once."""
    return lab.once(f"shadow {far_mm}", lambda: shadow_profile(lab, far_mm))


def _shadow_width(place: Array, profile: Array, side: int) -> float:
    """How wide the shadow beside the square is, on its negative or positive side, pixels.

    From the square's edge to where a sharp shadow with as little light in all would end: the
    pixels beyond the darkest one count by the light they lack, those nearer wholly, for what is
    light there is the square's own blurred rim.
    """
    out = (side * place > HALF_PX) & np.isfinite(profile)
    away, light = side * place[out] - HALF_PX, np.clip(profile[out], 0.0, 1.0)
    order = np.argsort(away)
    away, lack = away[order], 1.0 - light[order]
    lack[lack < 0.05] = 0.0
    if not lack.any():
        return 0.0
    darkest = int(lack.argmax())
    return float(away[darkest] - 0.5 + lack[darkest:].sum())


def shadows(lab: Lab) -> dict[str, Measured]:
    """Checks 20 and 21."""
    found: dict[str, float] = {}
    others: list[float] = []
    for far in (1100, 1500, 2000):
        place, profile, _ = shadow_of(lab, far)
        found[f"{far / 1000:g} m"] = _shadow_width(place, profile, -1)
        others.append(_shadow_width(place, profile, 1))
        place, profile, _ = shadow_profile(lab, far, horizontal=False)
        others += [_shadow_width(place, profile, side) for side in (-1, 1)]
    found["other sides"] = max(others, key=abs)
    return {"20": Measured(found, _expected(lab)), "21": _penumbra(lab)}


def _expected(lab: Lab) -> str:
    emitters = lab.bench.rig.emitters
    if not emitters:
        return "the rig has no emitter"
    baseline = float(np.mean([e.position_m[0] for e in emitters]))
    focal = lab.bench.rig.intrinsics.fx
    widths = (f"{shadow_px(baseline, focal, 0.9, z):.1f}" for z in (1.1, 1.5, 2.0))
    return f"b f (1/Zo - 1/Zb) of this rig: {', '.join(widths)} px"


def _penumbra(lab: Lab) -> Measured:
    """Check 21: plateaus of light on the shadowed side of a square before a wall at 2 m."""
    place, profile, shots = shadow_of(lab, 2000)
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
    middle = slice(_SHADOW_PX // 2 - 10, _SHADOW_PX // 2 + 10)
    sigma = measure.sigma_temporal_map(shots.frames_mm[:, middle])
    lit = measure.mean_of(sigma[:, place > 40])
    growth = [measure.ratio(measure.mean_of(sigma[:, column]), lit) for column in columns]
    shares = ", ".join(f"{level:.2f}" for level in levels)
    return Measured(
        {"levels": float(len(levels)), "sigma": float(np.fmax.reduce(growth))}, f"levels {shares}"
    )
