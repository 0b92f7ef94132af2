"""Checks 15 to 21 and 31 to 34 at depth edges: jitter, mixed pixels, silhouettes, shadows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from glsim.bench import scenes
from glsim.bench.validate.captures import INTERNAL, Captures
from glsim.bench.validate.report import Measurement, validation_check
from glsim.core.array_types import Array
from glsim.core.depth_frame import DepthFrame, Frames
from glsim.core.units import MM_PER_M
from glsim.measures import stacks as measure
from glsim.measures.silhouettes import measure_silhouettes
from glsim.simulation.virtual_camera import Changes

NEAR_MM = 900.0
_EDGE_PX = 96
#: Half the side of the square that casts a shadow, and the side of the window around it, px.
HALF_PX = 20.0
_SHADOW_PX = 128
#: Bars before a wall: their S (disparity step, px per m of baseline), and the wall's distance and
#: albedos. Taken from 44 real frames: deciles of S of all silhouettes, and their usual backgrounds.
_BAR_SHIFTS = (16, 40, 60, 80, 115, 155, 195, 240, 300, 400)
_BAR_WALL_MM, _BAR_ALBEDOS = 2200.0, (0.12, 0.22, 0.35)
#: Range of infrared of backgrounds, counts, in which real gaps depend on S alone; and inner and
#: outer radius of a ring in the image, px.
_BACK_COUNTS, _RING_PX = (600.0, 2500.0), (150.0, 225.0)
#: Largest depth difference beside a silhouette without background, mm. Noise causes 30 mm; stray
#: light in the lens causes 61 mm, as measured beside printed edges in real frames.
_STRAY_MM = 90.0


def capture_edge(captures: Captures, far_mm: float, changes: Changes | None = None) -> Frames:
    """Capture 64 rows of a fully lit edge at 0.9 m in front of a wall at ``far_mm``."""
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

    The growth per side is computed from the widths of the square's rows and columns.
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
        scenes.rectangle((-half, half), (-half, half), NEAR_MM), crop=128, changes=changes,
        scene="silhouette", frames=captures.scene_frames,
    )  # fmt: skip
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
    """Measure the light along a line on a wall; a square of 40 px at 0.9 m casts its shadow there.

    Returns (N,) distances from the optical axis, px; (N,) infrared divided by the infrared without
    the square, 0 to 1, NaN on the square; and the capture.
    """
    focal = captures.camera.rig.intrinsics.fx
    half = HALF_PX * NEAR_MM / focal
    capture = captures.camera.capture(
        scenes.occluder(NEAR_MM, far_mm, half), crop=_SHADOW_PX, scene=f"shadow {far_mm}",
        frames=captures.scene_frames,
    )  # fmt: skip
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


def _shadow_width(place: Array, profile: Array, side: int) -> float:
    """Compute the width of the shadow beside the square, px; ``side``: -1 or 1.

    The result is the width of a sharp shadow that removes as much light. Pixels outside the darkest
    pixel count with the share of light that they lack. Pixels between it and the square count in
    full, since their light comes from the blurred rim of the square.
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
    """Measure checks 20 and 21: widths of shadows, and steps of light in the penumbra."""
    widths: dict[str, float] = {}
    others: list[float] = []
    for far in (1100, 1500, 2000):
        across = shadow_profile(captures, far)
        widths[f"{far / MM_PER_M:g} m"] = _shadow_width(*across[:2], -1)
        others.append(_shadow_width(*across[:2], 1))
        down = shadow_profile(captures, far, horizontal=False)
        others += [_shadow_width(*down[:2], side) for side in (-1, 1)]
    widths["other sides"] = max(others, key=abs)
    return {"20": Measurement(widths), "21": _penumbra(*across)}


def _penumbra(place: Array, profile: Array, capture: Frames) -> Measurement:
    """Measure check 21: light levels on the shadow side of a square before a wall at 2 m."""
    side = (place < 0) & np.isfinite(profile)
    inner = np.flatnonzero(side & (profile > 0.15) & (profile < 0.85))
    # A level is a column whose neighbours have nearly the same light.
    columns = [int(c) for c in inner if np.ptp(profile[c - 1 : c + 2]) < 0.12]
    levels: list[float] = []
    for light in profile[columns].tolist():
        if not levels or abs(light - levels[-1]) > 0.15:
            levels.append(light)
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


@validation_check("kinect-v2")
def bars(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 31 to 34 on bars before a wall."""
    shots: list[DepthFrame] = []
    for shift in _BAR_SHIFTS:
        near_mm = MM_PER_M / (shift / captures.camera.rig.intrinsics.fx + MM_PER_M / _BAR_WALL_MM)
        for albedo in _BAR_ALBEDOS:
            mesh, name = scenes.bars(near_mm, _BAR_WALL_MM, albedo), f"bars {shift} {albedo}"
            shots += captures.camera.capture(mesh, 1, None, scene=name)
    if not any(np.any(shot.infrared) for shot in shots):
        return {n: Measurement(why_not="the sensor gives no infrared") for n in _GAPS}
    return gap_measurements(shots)


_GAPS = ("31", "32", "33", "34")


def gap_measurements(frames: Sequence[DepthFrame]) -> dict[str, Measurement]:
    """Measure checks 31 to 34, the gaps beside foregrounds, in real or simulated Kinect V2 frames.

    The frames need infrared. Returns widths, px and mm, and shares, percent.
    """
    lit, dark = measure_silhouettes(frames, light=_BACK_COUNTS).lit_and_shadow
    _, ring = measure_silhouettes(frames, _RING_PX, _BACK_COUNTS).lit_and_shadow
    values = (
        {"slope": dark.slope_mm, "offset": dark.offset_px},
        {"invalid": 100 * dark.band_invalid, "behind": 100 * dark.band_behind},
        {"behind": 100 * lit.band_behind},
        {"invalid": 100 * ring.band_invalid},
    )
    return {number: Measurement(v) for number, v in zip(_GAPS, values, strict=True)}
