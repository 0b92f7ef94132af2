"""Checks of the depth itself: quantisation, validity, range, wiggle, offsets (22 to 29)."""

from __future__ import annotations

import numpy as np

from glsim.validate import measure, scenes
from glsim.validate.lab import Lab
from glsim.validate.measure import Array
from glsim.validate.report import Measured

#: Allowed periods of the ripple of three taps at 80, 16 and 120 MHz, mm: 3 and 6 cycles a half
#: wavelength; and that of four taps at 80 MHz, which must be absent.
WIGGLE_PERIODS_MM = (3125.0, 1562.0, 625.0, 417.0, 312.0, 208.0)
FOUR_TAP_PERIOD_MM = 468.0

#: Frames and side of the window of each of the 121 walls that wiggling is measured on.
_WIGGLE_FRAMES = 6
_WIGGLE_PX = 40

#: Libfreenect2's infrared image is 16 times the mean amplitude.
COUNTS_PER_AMPLITUDE = 16.0


def quantisation(lab: Lab) -> dict[str, Measured]:
    """Check 22 and the first anti-check."""
    ramp = lab.bench.shoot(
        scenes.ten_centimetres(lab.bench.rig.intrinsics.fx), crop=96, scene="ramp"
    )
    levels = scenes.levels_on_ramp(ramp.encoded)
    fine = lab.wall(900).fine_mm
    fine = fine[np.isfinite(fine)]
    # What the chain leaves is compared in float32: a thousandth of a mm is not a fraction.
    fractions = float((np.abs(fine - np.rint(fine)) > 1e-3).mean()) if fine.size else float("nan")
    values: dict[str, float | None] = {
        "fractions": fractions, "levels": float(levels), "variance": None
    }  # fmt: skip
    if lab.knobs.no_rounding is not None:
        exact = lab.wall(900, changes=lab.knobs.no_rounding).fine_mm
        added = lab.wall(900).frames_mm - exact
        values["variance"] = measure.mean_of((added - measure.mean_of(added)) ** 2)
    return {
        "22": Measured(values, "" if lab.knobs.no_rounding is not None else
                       "the chain's rounding cannot be switched off"),
        "A1": Measured({"missing": 100.0 * (101 - levels) / 101}),
    }  # fmt: skip


def validity_curve(lab: Lab) -> tuple[Array, Array, float] | None:
    """Amplitudes, share of valid pixels at each, and that at 11 and above. None without infrared.

    One wall at 3 m whose albedo grows from left to right; the amplitude is that of a white wall
    times the albedo.
    """
    z, half_px = 3000.0, 64
    half_mm = half_px * z / lab.bench.rig.intrinsics.fx
    bright = float(lab.wall(z).centre(16, 16).infrared.mean()) / COUNTS_PER_AMPLITUDE
    if bright <= 0:
        return None
    low, high = 1.0 / bright, min(17.0 / bright, 1.0)
    shots = lab.bench.shoot(
        scenes.albedo_ramp(z, half_mm, low, high), crop=2 * half_px, at_mm=(0, 0, z),
        scene="albedo ramp", frames=lab.many,
    ).centre(2 * half_px - 4, 96)  # fmt: skip
    reflects = low + (high - low) * (shots.rays[0, :, 0] * z / (2 * half_mm) + 0.5)
    amplitude = bright * reflects
    share = np.isfinite(shots.frames_mm).mean(axis=(0, 1))
    bins = np.arange(1.0, 17.0, 0.5)
    which = np.digitize(amplitude, bins) - 1
    used = np.unique(which[(which >= 0) & (which < len(bins))])
    x = np.array([amplitude[which == b].mean() for b in used])
    y = np.array([share[which == b].mean() for b in used])
    return x, y, measure.mean_of(share[amplitude >= 11])


def validity(lab: Lab) -> dict[str, Measured]:
    """Check 23."""
    found = lab.once("validity", lambda: validity_curve(lab))
    if found is None:
        return {"23": Measured(why_not="the sensor gives no infrared")}
    amplitude, share, above = found
    return {"23": Measured({"a*": measure.crossing(amplitude, share, 0.5), "valid": 100 * above})}


def ranges(lab: Lab) -> dict[str, Measured]:
    """Check 25: walls on both sides of both gates; 30 mm from them, so that noise is no matter."""

    def valid(z: float) -> float:
        shots = lab.bench.shoot(scenes.wall(z), 8, 24, at_mm=(0, 0, z), scene=f"range {z}")
        return 100.0 * float(np.isfinite(shots.frames_mm).mean())

    outside = max(valid(z) for z in (300, 470, 4530, 5500))
    inside = min(valid(z) for z in (530, 2000, 4470))
    return {"25": Measured({"outside": outside, "inside": inside})}


def wiggle_curve(lab: Lab) -> tuple[Array, Array]:
    """Distances of walls, 0.6 to 3 m each 20 mm, and the mean error at each, mm."""
    distances = np.arange(600.0, 3001.0, 20.0)
    errors = []
    for z in distances:
        shots = lab.bench.shoot(
            scenes.wall(float(z)),
            _WIGGLE_FRAMES,
            _WIGGLE_PX,
            at_mm=(0, 0, float(z)),
            scene=f"wiggle {z:g}",
        )
        errors.append(measure.mean_of(shots.fine_mm - shots.clean_mm))
    return distances, np.array(errors)


def wiggle(lab: Lab) -> dict[str, Measured]:
    """Check 26. Other power: rms after a fit of all allowed periods relative to that before it."""
    z, error = lab.once("wiggle", lambda: wiggle_curve(lab))
    if not np.isfinite(error).all():
        return {"26": Measured({}, f"no depth at {z[~np.isfinite(error)][0]:.0f} mm")}
    ripple = measure.without_trend(z, error)
    noise = lab.sigma_t(2000) / np.sqrt(_WIGGLE_FRAMES * _WIGGLE_PX**2 / 9)
    _, _, left = measure.sinusoids(z, error, WIGGLE_PERIODS_MM)
    amplitudes, _, _ = measure.sinusoids(z, error, (*WIGGLE_PERIODS_MM, FOUR_TAP_PERIOD_MM))
    rms = float(np.sqrt((ripple**2).mean()))
    largest = float(amplitudes[:-1].max())
    return {"26": Measured(
        {
            "peak": float(np.abs(ripple).max()),
            "other": 100.0 * max(left**2 - noise**2, 0.0) / max(rms**2, 1e-12),
            "468 mm": 100.0 * float(amplitudes[-1] ** 2) / max(largest**2, 1e-12),
        },
        ", ".join(f"{p:.0f} mm: {a:.2f}" for p, a in
                  zip(WIGGLE_PERIODS_MM, amplitudes, strict=False)) + " (amplitudes, mm)",
    )}  # fmt: skip


def unwrapping(lab: Lab) -> dict[str, Measured]:
    """Check 28: walls as dark as an amplitude of 15 allows, at distances all over the range."""
    gross = total = 0
    for z in (520, 750, 1000, 1250, 1500, 1750, 2000, 2500, 3000, 3500, 4000, 4450):
        bright = float(lab.wall(900).infrared.mean()) / COUNTS_PER_AMPLITUDE * (900 / z) ** 2
        shots = lab.bench.shoot(
            scenes.wall(z, min(1.0, 15.0 / max(bright, 15.0))), lab.many, at_mm=(0, 0, z),
            scene=f"dark {z}",
        )  # fmt: skip
        residual = shots.residual_mm
        gross += int((np.abs(residual) > 300).sum())
        total += int(np.isfinite(residual).sum())
    share = gross / total if total else float("nan")
    return {"28": Measured({"gross": share}, f"{gross} of {total} valid pixels")}


def offsets(lab: Lab) -> dict[str, Measured]:
    """Check 29: devices are seeds; skin is measured against the same wall without the option."""
    means = []
    first = lab.bench.seed
    for device in range(first, first + 8):
        shots = lab.bench.shoot(
            scenes.wall(900), 4, 128, at_mm=(0, 0, 900), scene="offset", seed=device
        )
        means.append([measure.mean_of(frame) for frame in shots.fine_mm - shots.clean_mm])
    errors = np.array(means)
    values: dict[str, float | None] = {
        "skin": None,
        "offset": float(errors.mean(axis=1)[np.abs(errors.mean(axis=1)).argmax()]),
        "change": float(errors.std(axis=1, ddof=1).max()),
    }
    note = f"largest of {len(errors)} devices"
    if lab.knobs.skin is not None:
        plain = lab.mean_error(900, 0.6)
        values["skin"] = lab.mean_error(900, 0.6, lab.knobs.skin) - plain
    else:
        note += "; the chain has no option for skin"
    return {"29": Measured(values, note)}
