"""Checks 22, 23, 25, 26, 28, 29, A1: quantisation, validity, range, wiggle, unwrapping, offsets."""

from __future__ import annotations

import numpy as np

from glsim.bench import scenes
from glsim.bench.validate.captures import Captures
from glsim.bench.validate.report import Measurement, validation_check
from glsim.measures import stacks as measure
from glsim.sensors.kinect_v2 import COUNTS_PER_AMPLITUDE

#: Periods of the ripple of three taps at 80, 16 and 120 MHz, mm: 3 and 6 cycles per half
#: wavelength. The period of four taps at 80 MHz must be absent.
WIGGLE_PERIODS_MM = (3125.0, 1562.0, 625.0, 417.0, 312.0, 208.0)
FOUR_TAP_PERIOD_MM = 468.0
#: The wiggling is measured on 121 walls: frames per wall, and side of the captured window, px.
_WIGGLE_FRAMES = 6
_WIGGLE_PX = 40
#: Albedo of skin and of a dark surface, relative to white.
_SKIN, _DARK = 0.6, 0.4


@validation_check("kinect-v2")
def quantisation(captures: Captures) -> dict[str, Measurement]:
    """Measure check 22 and anti-check A1: rounding to mm, and depth levels on a ramp."""
    levels = captures.levels_on_ramp()
    wall = captures.wall(900)
    fine = wall.measured_mm[np.isfinite(wall.measured_mm)]
    # Depth is float32, so that a whole number may be off by up to 0.001 mm.
    fractions = float((np.abs(fine - np.rint(fine)) > 1e-3).mean()) if fine.size else float("nan")
    variance, note = None, "the chain's rounding cannot be switched off"
    if (off := captures.ablation("no_rounding")) is not None:
        exact = captures.wall(900, changes=off)
        added = wall.whole_mm - exact.measured_mm
        variance, note = measure.mean_of((added - measure.mean_of(added)) ** 2), ""
    values = {"fractions": fractions, "levels": float(levels), "variance": variance}
    return {
        "22": Measurement(values, note),
        "A1": Measurement({"missing": 100.0 * (101 - levels) / 101}),
    }


@validation_check("kinect-v2")
def validity(captures: Captures) -> dict[str, Measurement]:
    """Measure check 23: the amplitude at which half of the pixels are valid.

    The scene is a wall at 3 m with a ramp of albedo. The amplitude of a pixel is its measured
    infrared (with noise) divided by 16, as in the real frames.
    """
    z, half_px = 3000.0, 64
    half_mm = half_px * z / captures.camera.rig.intrinsics.fx
    bright = float(captures.wall(z).centre(16, 16).stack("infrared").mean()) / COUNTS_PER_AMPLITUDE
    if bright <= 0:
        return {"23": Measurement(why_not="the sensor gives no infrared")}
    low, high = 1.0 / bright, min(17.0 / bright, 1.0)
    capture = captures.camera.capture(
        scenes.albedo_ramp(z, half_mm, low, high),
        crop=2 * half_px,
        scene="albedo ramp",
        frames=captures.scene_frames,
    ).centre(2 * half_px - 4, 96)
    amplitude = capture.stack("infrared").ravel() / COUNTS_PER_AMPLITUDE
    valid = np.isfinite(capture.whole_mm).ravel()
    above = (amplitude >= 11) & (amplitude < 17)
    values = {
        "a*": measure.half_valid(amplitude, valid, np.arange(1.0, 17.5, 0.5)),
        "valid": 100 * measure.mean_of(valid[above].astype(np.float64)),
    }
    return {"23": Measurement(values)}


@validation_check("kinect-v2")
def ranges(captures: Captures) -> dict[str, Measurement]:
    """Measure check 25: validity of walls just inside and outside both range limits.

    The walls are at least 30 mm away from the range limits, so that noise has no effect. They are
    too dark to saturate: real frames lose paper beyond 63,000 counts, and a wall of albedo 0.6 at
    530 mm would have 64,700.
    """
    outside = max(captures.valid_percent(z, _DARK) for z in (300, 470, 4530, 5500))
    inside = min(captures.valid_percent(z, _DARK) for z in (530, 2000, 4470))
    return {"25": Measurement({"outside": outside, "inside": inside})}


@validation_check("kinect-v2")
def wiggle(captures: Captures) -> dict[str, Measurement]:
    """Measure check 26: ripple of the mean error on skin-like walls, every 20 mm to 3000 mm.

    "other": share of the error's power that remains after a fit of all allowed periods.
    """
    z = np.arange(600.0, 3001.0, 20.0)
    shots = (
        captures.camera.capture(
            scenes.wall(float(at), _SKIN), _WIGGLE_FRAMES, _WIGGLE_PX, scene=f"wiggle {at:g}"
        )
        for at in z
    )
    error = np.array([measure.mean_of(shot.measured_mm - shot.truth_mm) for shot in shots])
    if not np.isfinite(error).all():
        return {"26": Measurement({}, f"no depth at {z[~np.isfinite(error)][0]:.0f} mm")}
    ripple = measure.without_trend(z, error)
    noise = captures.temporal_sigma_mm(2000) / np.sqrt(_WIGGLE_FRAMES * _WIGGLE_PX**2 / 9)
    _, _, residual = measure.sinusoids(z, error, WIGGLE_PERIODS_MM)
    amplitudes, _, _ = measure.sinusoids(z, error, (*WIGGLE_PERIODS_MM, FOUR_TAP_PERIOD_MM))
    rms = float(np.sqrt((ripple**2).mean()))
    largest = float(amplitudes[:-1].max())
    values = {
        "peak": float(np.abs(ripple).max()),
        "other": 100.0 * max(residual**2 - noise**2, 0.0) / max(rms**2, 1e-12),
        "468 mm": 100.0 * float(amplitudes[-1] ** 2) / max(largest**2, 1e-12),
    }
    waves = (f"{p:.0f} mm: {a:.2f}" for p, a in zip(WIGGLE_PERIODS_MM, amplitudes, strict=False))
    return {"26": Measurement(values, ", ".join(waves) + " (amplitudes, mm)")}


@validation_check("kinect-v2")
def unwrapping(captures: Captures) -> dict[str, Measurement]:
    """Measure check 28: gross errors on walls of amplitude 15 over the whole range."""
    gross = total = 0
    for z in (520, 750, 1000, 1250, 1500, 1750, 2000, 2500, 3000, 3500, 4000, 4450):
        near = captures.wall(900, _SKIN).stack("infrared").mean() / _SKIN
        bright = float(near) / COUNTS_PER_AMPLITUDE * (900 / z) ** 2
        dimmed = scenes.wall(z, 15.0 / max(bright, 15.0))
        capture = captures.camera.capture(dimmed, captures.scene_frames, scene=f"dark {z}")
        residual = capture.residual_mm
        gross += int((np.abs(residual) > 300).sum())
        total += int(np.isfinite(residual).sum())
    share = gross / total if total else float("nan")
    return {"28": Measurement({"gross": share}, f"{gross} of {total} valid pixels")}


@validation_check("kinect-v2")
def offsets(captures: Captures) -> dict[str, Measurement]:
    """Measure check 29: mean error of eight devices (seeds), its drift in time, and bias of skin.

    The bias of skin is the difference from the same wall without the skin option.
    """
    means = []
    first = captures.camera.seed
    for device in range(first, first + 8):
        capture = captures.camera.capture(scenes.wall(900), 4, 128, scene="offset", seed=device)
        means.append([measure.mean_of(frame) for frame in capture.measured_mm - capture.truth_mm])
    errors = np.array(means)
    values: dict[str, float | None] = {
        "skin": None,
        "offset": float(errors.mean(axis=1)[np.abs(errors.mean(axis=1)).argmax()]),
        "change": float(errors.std(axis=1, ddof=1).max()),
    }
    note = f"largest of {len(errors)} devices"
    if (skin := captures.ablation("skin")) is not None:
        plain = captures.mean_error_mm(900, 0.6)
        values["skin"] = captures.mean_error_mm(900, 0.6, skin) - plain
    else:
        note += "; the chain has no option for skin"
    return {"29": Measurement(values, note)}
