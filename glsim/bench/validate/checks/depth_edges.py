"""Checks 15 to 21 at depth edges: jitter, mixed pixels, silhouettes, shadows."""

from __future__ import annotations

import numpy as np

from glsim.bench.measures import stacks as measure
from glsim.bench.measures.stacks import Array
from glsim.bench.validate import scenes
from glsim.bench.validate.captures import INTERNAL, Captures
from glsim.bench.validate.report import Measurement, validation_check
from glsim.bench.validate.virtual_camera import Changes
from glsim.core.depth_frame import Frames

NEAR_MM = 900.0
_EDGE_PX = 96
#: Half the side of the square that casts shadows, and the side of the window around it, px.
HALF_PX = 20.0
_SHADOW_PX = 128
#: Most that depth beside a lone silhouette may differ, mm: 30 of noise, and the 61 by which the
#: light of the lens's halo is late, as real frames show beside printed edges.
_STRAY_MM = 90.0


def capture_edge(captures: Captures, far_mm: float, changes: Changes | None = None) -> Frames:
    """Capture 64 rows of a fully lit edge at 0.9 m before a wall at ``far_mm``."""
    return captures.camera.capture(
        scenes.depth_edge(NEAR_MM, far_mm),
        crop=_EDGE_PX,
        changes=changes,
        scene=f"edge {far_mm}",
        frames=captures.scene_frames,
    ).centre(48, 64)


@validation_check("kinect-v2")
def mixed_pixels(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 15 to 18: edge jitter, mixed and invalid pixels, with and without filters."""
    filtered = capture_edge(captures, 1500)
    on = measure.mixed_per_row(filtered.measured_mm, NEAR_MM, 1500)
    small = measure.mixed_per_row(capture_edge(captures, 950).measured_mm, NEAR_MM, 950)
    jitter = measure.edge_jitter(measure.edge_positions(filtered.whole_mm, NEAR_MM, 1500))
    measurements = {
        "15": Measurement({"std": jitter}),
        "18": Measurement({"0.95 m": small[2], "1.5 m": on[2]}),
    }
    off = captures.ablation("no_filters")
    if off is None:
        return measurements | {n: Measurement(why_not=INTERNAL) for n in ("16", "17")}
    raw = measure.mixed_per_row(capture_edge(captures, 1500, off).measured_mm, NEAR_MM, 1500)
    deep = measure.mixed_per_row(capture_edge(captures, 2000, off).measured_mm, NEAR_MM, 2000)
    measurements["16"] = Measurement({"off": raw[0], "off, outside": raw[1], "on": on[0]})
    measurements["17"] = Measurement({"between": deep[0], "outside": deep[1]})
    return measurements


@validation_check("kinect-v2")
def silhouette(captures: Captures) -> dict[str, Measurement]:
    """Measure check 19: growth and stray pixels of a square without background.

    Growth per side is computed from the widths of its rows and columns.
    """
    off = captures.ablation("no_filters")
    values = _measure_silhouette(captures, off)
    if off is None:
        return {
            "19": Measurement(values, "with all stages: this chain has no filters to switch off")
        }
    exception = ""
    if values["strays"] > 0 and (exactly := captures.ablation("no_light_noise")) is not None:
        exact = _measure_silhouette(captures, {**off, **exactly})
        if exact["strays"] == 0:
            exception = (
                "0 strays without noise of the light, so these are no mixed pixels: dark rims that "
                f"the thresholds of check 23 accept (3 to 8) have more than {_STRAY_MM:.0f} mm of "
                "raw noise at times by checks 9 and 10 (45 mm at 10)"
            )
    return {"19": Measurement(values, exception=exception)}


def _measure_silhouette(captures: Captures, changes: Changes | None) -> dict[str, float]:
    half = 40.0 * NEAR_MM / captures.camera.rig.intrinsics.fx
    capture = captures.camera.capture(
        scenes.rectangle((-half, half), (-half, half), NEAR_MM),
        crop=128,
        changes=changes,
        scene="silhouette",
        frames=captures.scene_frames,
    )
    away = np.abs(np.nan_to_num(capture.measured_mm, nan=NEAR_MM) - NEAR_MM)
    close = np.isfinite(capture.measured_mm) & (away <= _STRAY_MM)
    clean = np.isfinite(capture.truth_mm)
    middle = slice(64 - 24, 64 + 24)
    rows = close[:, middle].sum(axis=2) - clean[middle].sum(axis=1)
    columns = close[:, :, middle].sum(axis=1) - clean[:, middle].sum(axis=0)
    growth = np.concatenate([rows.ravel(), columns.ravel()]) / 2.0
    return {
        "strays": float((away > _STRAY_MM).sum()) / len(away),
        "growth": float(growth[np.abs(growth).argmax()]),
        "mean growth": float(growth.mean()),
    }


def shadow_profile(
    captures: Captures, far_mm: float, horizontal: bool = True
) -> tuple[Array, Array, Frames]:
    """Measure the light along a line on the wall behind a square of +-20 px at 0.9 m.

    Returns (N,) distances from the axis, px; (N,) light, the infrared relative to the same wall
    without the square, 0 to 1, NaN on the square; and the capture.
    """
    focal = captures.camera.rig.intrinsics.fx
    half = HALF_PX * NEAR_MM / focal
    capture = captures.camera.capture(
        scenes.occluder(NEAR_MM, far_mm, half),
        crop=_SHADOW_PX,
        scene=f"shadow {far_mm}",
        frames=captures.scene_frames,
    )
    bare = captures.camera.capture(scenes.wall(far_mm), 8, _SHADOW_PX, scene=f"unshadowed {far_mm}")
    light = capture.stack("infrared").mean(axis=0) / np.maximum(
        bare.stack("infrared").mean(axis=0), 1.0
    )
    light = np.where(capture.truth_mm > far_mm - 1, light, np.nan)
    band = slice(_SHADOW_PX // 2 - 10, _SHADOW_PX // 2 + 10)
    image = light[band] if horizontal else light[:, band].T
    profile = np.array([measure.mean_of(column) for column in image.T])
    seen = capture[0].rays
    rays = seen[0, :, 0] if horizontal else seen[:, 0, 1]
    return np.asarray(rays * focal, np.float64), profile, capture


def horizontal_shadow(captures: Captures, far_mm: float) -> tuple[Array, Array, Frames]:
    """Return the horizontal ``shadow_profile``, which is measured once."""
    return captures.cached(f"shadow {far_mm}", lambda: shadow_profile(captures, far_mm))


def _shadow_width(place: Array, profile: Array, side: int) -> float:
    """Compute the width of the shadow beside the square, px.

    It is the width of a sharp shadow that takes as much light: pixels beyond the darkest one count
    by the light that they lack. Pixels between the square and the darkest one count in full, since
    their light is the blurred rim of the square.

    Args:
        side: -1 or 1.
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


@validation_check("kinect-v2")
def shadows(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 20 and 21: widths of shadows, and light levels in the penumbra."""
    widths: dict[str, float] = {}
    others: list[float] = []
    for far in (1100, 1500, 2000):
        place, profile, _ = horizontal_shadow(captures, far)
        widths[f"{far / 1000:g} m"] = _shadow_width(place, profile, -1)
        others.append(_shadow_width(place, profile, 1))
        place, profile, _ = shadow_profile(captures, far, horizontal=False)
        others += [_shadow_width(place, profile, side) for side in (-1, 1)]
    widths["other sides"] = max(others, key=abs)
    return {"20": Measurement(widths), "21": _penumbra(captures)}


def _penumbra(captures: Captures) -> Measurement:
    """Measure check 21: light levels on the shadow side of a square before a wall at 2 m."""
    place, profile, capture = horizontal_shadow(captures, 2000)
    side = (place < 0) & np.isfinite(profile)
    inner = np.flatnonzero(side & (profile > 0.15) & (profile < 0.85))
    # A level is a column whose neighbours have nearly the same light.
    levels: list[float] = []
    columns: list[int] = []
    for column in inner:
        around = profile[column - 1 : column + 2]
        if np.isfinite(around).all() and np.ptp(around) < 0.12:
            if not levels or abs(profile[column] - levels[-1]) > 0.15:
                levels.append(float(profile[column]))
            columns.append(int(column))
    if not columns:
        return Measurement(
            {"levels": 0.0, "sigma": None}, "light falls from full to none within a pixel or two"
        )
    middle = slice(_SHADOW_PX // 2 - 10, _SHADOW_PX // 2 + 10)
    sigma = measure.sigma_temporal_map(capture.whole_mm[:, middle])
    lit = measure.mean_of(sigma[:, place > 40])
    growth = [measure.ratio(measure.mean_of(sigma[:, column]), lit) for column in columns]
    shares = ", ".join(f"{level:.2f}" for level in levels)
    return Measurement(
        {"levels": float(len(levels)), "sigma": float(np.fmax.reduce(growth))}, f"levels {shares}"
    )
