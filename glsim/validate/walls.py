"""Checks on walls: how much noise, its growth, its correlations (1 to 8, 12 to 14, 27)."""

from __future__ import annotations

import numpy as np

from glsim.validate import measure, scenes
from glsim.validate.lab import INTERNAL, Lab
from glsim.validate.report import Measured

#: Frames of the wall that the fixed pattern is measured on.
_PATTERN_FRAMES = 1000

_LAGS = ((0, 1), (0, 2), (0, 3), (1, 1), (2, 2))


def noise_level(lab: Lab) -> dict[str, Measured]:
    """Checks 1 to 5: sigma of frontal walls of albedo 1."""
    spatial = {z: lab.sigma_s(z) for z in (510, 900, 1200, 1500, 2000, 3000, 4000)}
    temporal = measure.sigma_temporal(lab.wall(900).frames_mm)
    near = [spatial[z] for z in (510, 900, 1200)]
    white = None
    if lab.knobs.white is not None:
        four, two = (lab.sigma_t(z, changes=lab.knobs.white) for z in (4000, 2000))
        white = measure.ratio(four, two)
    growth = {"all": measure.ratio(spatial[4000], spatial[2000]), "white": white}
    return {
        "1": Measured({"0.9 m": spatial[900]}),
        "2": Measured({"sigma_T": temporal,
                       "sigma_T/sigma_S": measure.ratio(temporal, spatial[900])}),
        "3": Measured({f"{z / 1000:g} m": spatial[z] for z in (1500, 2000, 3000, 4000)}),
        "4": Measured(growth, "" if white is not None else "has no white part to look at alone"),
        "5": Measured({"max/min": measure.ratio(max(near), min(near))},
                      "nearest wall at 0.51 m: 0.5 m is the range gate itself"),
    }  # fmt: skip


def tilt(lab: Lab) -> dict[str, Measured]:
    """Check 6: walls turned about the x axis, so that light meets them as the camera does.

    64 columns by 8 rows: at 80 degrees a row is 14 mm of depth.
    """
    flat = measure.sigma_spatial(lab.wall(900).centre(64, 8).residual_mm)
    ratios = {}
    for angle in (45, 60, 75, 80):
        shots = lab.bench.shoot(
            scenes.tilted(900, angle), at_mm=(0, 0, 900), scene=f"tilt {angle}", frames=lab.many
        )
        ratios[f"{angle} deg"] = measure.ratio(
            measure.sigma_spatial(shots.centre(64, 8).residual_mm), flat
        )
    return {"6": Measured(ratios)}


def albedo(lab: Lab) -> dict[str, Measured]:
    """Check 7: the white part of dark and bright walls."""
    white = lab.knobs.white
    if white is None:
        return {"7": Measured(why_not=INTERNAL)}
    ratios = {
        f"{z / 1000:g} m": measure.ratio(lab.sigma_t(z, 0.1, white), lab.sigma_t(z, 1.0, white))
        for z in (900, 2000)
    }
    return {"7": Measured(ratios)}


def amplitude(lab: Lab) -> dict[str, Measured]:
    """Check 8: infrared of walls over distance, albedo and tilt, averaged over frames."""

    def level(z: float, reflects: float = 1.0, angle: float = 0.0) -> float:
        mesh = scenes.wall(z, reflects) if angle == 0 else scenes.tilted(z, angle, reflects)
        shots = lab.bench.shoot(
            mesh, 16, 24, at_mm=(0, 0, z), scene=f"amplitude {z} {reflects} {angle}"
        )
        return float(shots.centre(8, 2).infrared.mean())

    full = level(900)
    views = ((0, 0.6), (0, 0.3), (30, 1), (60, 1), (60, 0.5))
    others = {(angle, reflects): level(900, reflects, angle) for angle, reflects in views}
    off = [
        measure.ratio(v, full * r * float(np.cos(np.radians(a)))) - 1
        for (a, r), v in others.items()
    ]
    worst = max(off, key=abs)
    return {"8": Measured({"ratio": measure.ratio(full, level(1800)), "deviation": 100 * worst})}


def correlations(lab: Lab) -> dict[str, Measured]:
    """Checks 12 and 13, and the anti-checks of the same numbers."""
    frames = lab.wall(900).frames_mm
    part = measure.temporal_part(frames)
    found = measure.autocorrelation(part, (*_LAGS, (0, 8)))
    skew, kurtosis = measure.skew_kurtosis(part)
    return {
        "12": Measured({f"({a},{b})": v for (a, b), v in zip(_LAGS, found, strict=False)},
                       "of the delivered frames: rounding to mm is part of them"),
        "13": Measured({"lag 1": measure.temporal_autocorrelation(frames),
                        "skew": skew, "kurtosis": kurtosis}),
        "A5": Measured({"lag 1": found[0]}),
        "A6": Measured({"lag 8": found[-1]}),
    }  # fmt: skip


def radial(lab: Lab) -> dict[str, Measured]:
    """Check 14: the same wall at the centre, at the rim of a face and in a corner."""
    z, image = 1500.0, lab.bench.rig.intrinsics

    def sigma(x: float, y: float) -> float:
        shots = lab.bench.shoot(
            scenes.wall(z), crop=40, at_mm=(z * x, z * y, z), scene=f"radial {x} {y}"
        )
        part = shots.centre(24).frames_mm
        if np.isfinite(part).mean() < 0.5:
            return float("inf")
        return measure.sigma_temporal(part)

    corner = (image.width - 20 - image.cx) / image.fx, (image.height - 20 - image.cy) / image.fy
    centre = lab.sigma_t(1500)
    rim = np.mean([sigma(*direction) for direction in ((0.18, 0), (-0.18, 0), (0, 0.18))])
    far = sigma(*corner)
    note = "corner: the 24 x 24 px nearest to it that a 40 px crop centres on"
    if np.isinf(far):
        values = {"r = 0.18": measure.ratio(float(rim), centre), "corner": None}
        return {"14": Measured(values, "no depth in the corner, which the sheet allows")}
    return {
        "14": Measured(
            {"r = 0.18": measure.ratio(float(rim), centre), "corner": measure.ratio(far, centre)},
            note,
        )
    }


def pattern(lab: Lab) -> dict[str, Measured]:
    """Check 27: many frames of one wall; the halves must show one map."""
    shots = lab.bench.shoot(
        scenes.wall(900), _PATTERN_FRAMES, 40, at_mm=(0, 0, 900), scene="pattern"
    ).centre(32)
    frames = shots.residual_mm
    _, sigma = measure.fixed_pattern(frames)
    half = len(frames) // 2
    first, second = (
        measure.fixed_pattern(part)[0].ravel() for part in (frames[:half], frames[half:])
    )
    ok = np.isfinite(first) & np.isfinite(second)
    same = 0.0
    if ok.any() and first[ok].std() > 0 and second[ok].std() > 0:
        same = float(np.corrcoef(first[ok], second[ok])[0, 1])
    total = measure.ratio(
        float(np.hypot(sigma, measure.sigma_temporal(frames))), measure.sigma_spatial(frames)
    )
    return {"27": Measured({"FPN": sigma, "same map": same, "sum": total})}


def exponent(lab: Lab) -> dict[str, Measured]:
    """Anti-check: the power of distance that temporal noise grows with below 1.5 m."""
    z = np.array([600.0, 900.0, 1200.0, 1500.0])
    sigma = [lab.sigma_s(float(at)) for at in z]
    if not min(sigma) > 0:
        return {"A2": Measured({})}
    slope = np.polyfit(np.log(z), np.log(sigma), 1)[0]
    return {"A2": Measured({"exponent": float(slope)})}


def skin(lab: Lab) -> dict[str, Measured]:
    """Anti-check: frontal skin, albedo 0.6, at 0.9 m."""
    return {"A4": Measured({"sigma": lab.sigma_s(900, 0.6)})}
