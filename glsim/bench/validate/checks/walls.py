"""Checks 1 to 8, 12 to 14, 27 and A2, A4 to A6 on walls: noise, its growth, its correlations."""

from __future__ import annotations

import numpy as np

from glsim.bench import scenes
from glsim.bench.validate.captures import INTERNAL, Captures
from glsim.bench.validate.report import Measurement, validation_check
from glsim.core.units import MM_PER_M
from glsim.measures import stacks as measure

#: Number of frames of the wall on which the fixed pattern is measured.
_PATTERN_FRAMES = 1000

_LAGS = ((0, 1), (0, 2), (0, 3), (1, 1), (2, 2))


@validation_check("kinect-v2")
def noise_level(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 1 to 5: noise sigma of frontal walls of albedo 1."""
    spatial = {z: captures.spatial_sigma_mm(z) for z in (700, 900, 1200, 1500, 2000, 3000, 4000)}
    temporal = measure.sigma_temporal(captures.wall(900).whole_mm)
    near = [spatial[z] for z in (700, 900, 1200)]
    white = None
    if (changes := captures.ablation("white")) is not None:
        four, two = (captures.temporal_sigma_mm(z, changes=changes) for z in (4000, 2000))
        white = measure.ratio(four, two)
    growth = {"all": measure.ratio(spatial[4000], spatial[2000]), "white": white}
    return {
        "1": Measurement({"0.9 m": spatial[900]}),
        "2": Measurement(
            {"sigma_T": temporal, "sigma_T/sigma_S": measure.ratio(temporal, spatial[900])}
        ),
        "3": Measurement({f"{z / MM_PER_M:g} m": spatial[z] for z in (1500, 2000, 3000, 4000)}),
        "4": Measurement(
            growth, "" if white is not None else "its white part cannot be measured alone"
        ),
        "5": Measurement(
            {"max/min": measure.ratio(max(near), min(near))},
            "white walls saturate nearer than 0.65 m",
        ),
    }


@validation_check("kinect-v2")
def tilt(captures: Captures) -> dict[str, Measurement]:
    """Measure check 6: noise on walls turned about x, so that light and view have equal angles.

    At 80 degrees, the depth of the wall changes by 14 mm per row.
    """
    flat = measure.sigma_spatial(captures.wall(900).centre(64, 8).residual_mm)
    ratios = {}
    for angle in (45, 60, 75, 80):
        strip, name = scenes.tilted(900, angle), f"tilt {angle}"
        shot = captures.camera.capture(strip, captures.scene_frames, scene=name).centre(64, 8)
        ratios[f"{angle} deg"] = measure.ratio(measure.sigma_spatial(shot.residual_mm), flat)
    return {"6": Measurement(ratios)}


@validation_check("kinect-v2")
def albedo(captures: Captures) -> dict[str, Measurement]:
    """Measure check 7: the white part of the noise, on dark and on bright walls."""
    white = captures.ablation("white")
    if white is None:
        return {"7": Measurement(why_not=INTERNAL)}
    ratios = {
        f"{z / MM_PER_M:g} m": measure.ratio(
            captures.temporal_sigma_mm(z, 0.1, white), captures.temporal_sigma_mm(z, 1.0, white)
        )
        for z in (900, 2000)
    }
    return {"7": Measurement(ratios)}


@validation_check("kinect-v2")
def amplitude(captures: Captures) -> dict[str, Measurement]:
    """Measure check 8: mean infrared of walls by distance, albedo and tilt."""

    def level(z: float, reflects: float = 1.0, angle: float = 0.0) -> float:
        mesh = scenes.wall(z, reflects) if angle == 0 else scenes.tilted(z, angle, reflects)
        capture = captures.camera.capture(mesh, 16, 24, scene=f"amplitude {z} {reflects} {angle}")
        return float(capture.centre(8, 2).stack("infrared").mean())

    full = level(900)
    views = ((0, 0.6), (0, 0.3), (30, 1), (60, 1), (60, 0.5))
    others = {(angle, reflects): level(900, reflects, angle) for angle, reflects in views}
    deviations = [
        measure.ratio(v, full * r * float(np.cos(np.radians(a)))) - 1
        for (a, r), v in others.items()
    ]
    worst = max(deviations, key=abs)
    return {"8": Measurement({"ratio": measure.ratio(full, level(1800)), "deviation": 100 * worst})}


@validation_check("kinect-v2")
def correlations(captures: Captures) -> dict[str, Measurement]:
    """Measure checks 12 and 13, and A5 and A6: correlations and distribution of the noise."""
    frames = captures.wall(900).whole_mm
    noise = measure.temporal_part(frames)
    correlation = measure.autocorrelation(noise, (*_LAGS, (0, 8)))
    skew, kurtosis = measure.skew_kurtosis(noise)
    return {
        "12": Measurement(
            {f"({a},{b})": v for (a, b), v in zip(_LAGS, correlation, strict=False)},
            "of the delivered frames, which are rounded to mm",
        ),
        "13": Measurement(
            {"lag 1": measure.temporal_autocorrelation(frames), "skew": skew, "kurtosis": kurtosis}
        ),
        "A5": Measurement({"lag 1": correlation[0]}),
        "A6": Measurement({"lag 8": correlation[-1]}),
    }


@validation_check("kinect-v2")
def radial(captures: Captures) -> dict[str, Measurement]:
    """Measure check 14: noise on a wall at the image centre, at the rim of a face, in a corner."""
    z, image = 1500.0, captures.camera.rig.intrinsics

    def sigma(x: float, y: float) -> float:
        capture = captures.camera.capture(
            scenes.wall(z), crop=40, at_mm=(z * x, z * y, z), scene=f"radial {x} {y}"
        )
        depth_mm = capture.centre(24).whole_mm
        known = np.isfinite(depth_mm).mean()
        return float("inf") if known < 0.5 else measure.sigma_temporal(depth_mm)

    corner = (image.width - 20 - image.cx) / image.fx, (image.height - 20 - image.cy) / image.fy
    centre = captures.temporal_sigma_mm(1500)
    rim = np.mean([sigma(*direction) for direction in ((0.18, 0), (-0.18, 0), (0, 0.18))])
    far = sigma(*corner)
    values: dict[str, float | None] = {"r = 0.18": measure.ratio(float(rim), centre)}
    if np.isinf(far):
        values["corner"] = None
        return {"14": Measurement(values, "no depth in the corner, which the sheet allows")}
    values["corner"] = measure.ratio(far, centre)
    note = "corner: the central 24 x 24 px of the outermost 40 px crop"
    return {"14": Measurement(values, note)}


@validation_check("kinect-v2")
def pattern(captures: Captures) -> dict[str, Measurement]:
    """Measure check 27: fixed pattern of a wall, which must repeat in both halves of the frames."""
    capture = captures.camera.capture(scenes.wall(900), _PATTERN_FRAMES, 40, scene="pattern")
    frames = capture.centre(32).residual_mm
    _, sigma = measure.fixed_pattern(frames)
    halves = np.array_split(frames, 2)
    first, second = (measure.fixed_pattern(half)[0].ravel() for half in halves)
    valid = np.isfinite(first) & np.isfinite(second)
    same = 0.0
    if valid.any() and first[valid].std() > 0 and second[valid].std() > 0:
        same = float(np.corrcoef(first[valid], second[valid])[0, 1])
    total = measure.ratio(
        float(np.hypot(sigma, measure.sigma_temporal(frames))), measure.sigma_spatial(frames)
    )
    return {"27": Measurement({"FPN": sigma, "same map": same, "sum": total})}


@validation_check("kinect-v2")
def near_walls(captures: Captures) -> dict[str, Measurement]:
    """Measure anti-checks A2 (exponent of noise over distance) and A4 (noise of frontal skin)."""
    z = np.array([700.0, 900.0, 1200.0, 1500.0])
    sigma = [captures.spatial_sigma_mm(float(at)) for at in z]
    slope = np.polyfit(np.log(z), np.log(sigma), 1)[0] if min(sigma) > 0 else np.nan
    return {
        "A2": Measurement({"exponent": float(slope)}),
        "A4": Measurement({"sigma": captures.spatial_sigma_mm(900, 0.6)}),
    }
