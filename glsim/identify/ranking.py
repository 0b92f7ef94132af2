"""Rank the cameras that may have made a recording, with reasons.

Each piece of evidence adds points to a camera, or takes some off; a point makes a camera e times as
likely. Points are chosen: the lattice of depths and a size that one camera alone has decide,
noise and holes speak for or against. ``unknown`` takes part with a fixed number of points.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from glsim.identify.cameras import CAMERAS, Camera, Size
from glsim.identify.evidence import Evidence

#: Points of a camera nobody knows.
_UNKNOWN = 2.5
#: Largest difference of the constants of two devices of one kind, as a logarithm: focal lengths
#: differ by 3 %, baselines by 1 % [the D435s' constants are 612,342 and 626,823].
_DEVICES = 0.05
#: Points: a lattice that fits or not; a size that fits, that no other camera has, or not.
_FITS, _MISFITS, _SIZE, _OWN_SIZE, _OTHER_SIZE = 6.0, -8.0, 1.5, 2.0, -1.5
#: Least number of values that must tell before a missing lattice counts.
_TELLING = 12
#: Infrared counts of imagers of 8 or 10 bits end here.
_IMAGER_COUNTS = 1023.0
UNKNOWN = "unknown"


@dataclass(frozen=True)
class Guess:
    """A camera that may have made a recording.

    Attributes:
        title: its name, or ``unknown``.
        sensor: sensor of glsim; "" for unknown.
        share: how sure, 0 to 1; the shares of all guesses add up to 1.
        reasons: in words, for and against.
        unit_mm: step of the files that its lattice or noise says; None if nothing tells.
        focal_baseline_px_mm: by the lattice; None without.
    """

    title: str
    sensor: str
    share: float
    reasons: tuple[str, ...] = ()
    unit_mm: float | None = None
    focal_baseline_px_mm: float | None = None


@dataclass(frozen=True)
class _Point:
    points: float
    reason: str


def rank_cameras(evidence: Evidence) -> list[Guess]:
    """Return all cameras and ``unknown``, the likeliest first."""
    rows: list[tuple[float, Guess]] = [(_UNKNOWN, Guess(UNKNOWN, "", 0.0))]
    for camera in CAMERAS:
        units = camera.units_mm
        if evidence.unit_mm is not None:
            units = tuple(u for u in units if math.isclose(u, evidence.unit_mm, rel_tol=1e-3))
        scored = [_score(camera, evidence, unit) for unit in units or camera.units_mm]
        rows.append(max(scored, key=lambda row: row[0]))
    weights = np.exp([points - max(p for p, _ in rows) for points, _ in rows])
    shares = (weights / weights.sum()).tolist()
    guesses = [
        Guess(g.title, g.sensor, share, g.reasons, g.unit_mm, g.focal_baseline_px_mm)
        for (_, g), share in zip(rows, shares, strict=True)
    ]
    return sorted(guesses, key=lambda guess: -guess.share)


def _score(camera: Camera, evidence: Evidence, unit_mm: float) -> tuple[float, Guess]:
    points = [
        *_by_size(camera, evidence),
        *_by_lattice(camera, evidence, unit_mm),
        *_by_noise(camera, evidence, unit_mm),
        *_by_holes(camera, evidence),
        *_by_infrared(camera, evidence),
    ]
    sensor = camera.sensors.get(evidence.size) or next(iter(camera.sensors.values()))
    found = evidence.lattice if evidence.has_lattice and camera.baseline_mm else None
    constant = None if found is None else found.constant * unit_mm / camera.steps
    reasons = tuple(f"{'+' if p.points > 0 else '-'} {p.reason}" for p in points)
    total = sum(p.points for p in points)
    return total, Guess(camera.title, sensor, 0.0, reasons, unit_mm, constant)


def _by_size(camera: Camera, evidence: Evidence) -> Iterator[_Point]:
    text = f"{evidence.size[0]}x{evidence.size[1]}"
    if evidence.size not in {*camera.sensors, *camera.focal_px}:
        yield _Point(_OTHER_SIZE, f"{text} is none of its modes")
        return
    yield _Point(_SIZE, f"{text} is one of its modes")
    others = [c for c in CAMERAS if evidence.size in {*c.sensors, *c.focal_px}]
    if len(others) == 1:
        yield _Point(_OWN_SIZE, "no other camera here has that size")


def _by_lattice(camera: Camera, evidence: Evidence, unit_mm: float) -> Iterator[_Point]:
    found = evidence.lattice
    if not camera.baseline_mm:
        if evidence.has_lattice:
            assert found is not None
            yield _Point(_MISFITS, f"depths are on a lattice, round({found.constant:,.0f} / n)")
        elif evidence.values.size >= _TELLING:
            yield _Point(1.0, "depths are on no lattice of disparities")
        return
    constants = camera.constants(unit_mm)
    own, expected, away = _nearest_mode(constants, evidence)
    if not evidence.has_lattice or found is None:
        if evidence.telling(expected) >= _TELLING:
            yield _Point(_MISFITS, f"depths are not round({expected:,.0f} / n), as its are")
        return
    product = found.constant * unit_mm / camera.steps
    text = (
        f"depths are round({found.constant:,.0f} / n): f B = {product:,.0f} px mm in steps of "
        f"1/{camera.steps} px and {unit_mm:g} mm; its are "
        f"{expected * unit_mm / camera.steps:,.0f} at {own[0]}x{own[1]}"
    )
    shifted = found.offset > 0
    if away > _DEVICES or (shifted and not camera.shifted):
        yield _Point(_MISFITS, text)
    else:
        share = 1.0 if own == evidence.size else 0.8  # another size: cut, or moved to colour
        yield _Point(share * _FITS * (1.0 - 0.5 * away / _DEVICES), text)


def _nearest_mode(constants: dict[Size, float], evidence: Evidence) -> tuple[Size, float, float]:
    """Return size, K and distance of the mode whose K is nearest.

    Of the recording's own size if it is a mode, else of the modes that it may be cut from.
    """
    width, height = evidence.size
    whole = {s: k for s, k in constants.items() if s[0] >= width and s[1] >= height}
    if evidence.size in constants:
        whole = {evidence.size: constants[evidence.size]}
    constants = whole or constants
    found = evidence.lattice
    if found is None or not found.accepted:
        size, constant = next(iter(constants.items()))
        return size, constant, float("inf")
    distance = {s: abs(math.log(found.constant / k)) for s, k in constants.items()}
    size = min(distance, key=lambda s: distance[s])
    return size, constants[size], distance[size]


def _by_noise(camera: Camera, evidence: Evidence, unit_mm: float) -> Iterator[_Point]:
    """Compare the residual of planes, and its correlation, with those of real frames."""
    noise, (low, high) = evidence.noise, camera.noise
    if not math.isfinite(noise.residual) or high == 0:
        return
    found, unit = noise.residual / unit_mm, "1/m"
    if camera.baseline_mm:
        if not evidence.has_lattice or evidence.lattice is None:
            return
        unit = "px"
        found *= evidence.lattice.constant * unit_mm / camera.steps / 1000.0
    fits = low <= found <= high
    text = f"planes have a residual of {found:.2g} {unit}; its {low:g} to {high:g} {unit}"
    yield _Point(1.0 if fits else -1.5, text)
    alike, (least, most) = noise.rows[3], camera.correlation
    if math.isfinite(alike):
        text = f"that of pixels 4 px apart is alike by {alike:.2f}; its by {least:g} to {most:g}"
        yield _Point(0.7 if least <= alike <= most else -1.0, text)


def _by_holes(camera: Camera, evidence: Evidence) -> Iterator[_Point]:
    left, right = evidence.band_px
    if camera.shadow == "left" and math.isfinite(left):
        if left >= right + 3:
            yield _Point(
                0.7, f"the left border has no depth on {left:.0f} px, the right {right:.0f}"
            )
        elif left <= 2:
            yield _Point(-1.5, "there is no band without depth at the left border")
    _, _, above, below = evidence.gaps_px
    if camera.shadow == "upright" and below >= above + 3:  # not where one is NaN
        text = f"gaps are {below:.0f} px wide below foregrounds, {above:.0f} px above"
        yield _Point(1.0, text)
    if camera.masked:
        if evidence.corners < 0.02:
            yield _Point(1.5, "the corners have no depth: its field of view is a hexagon or circle")
        elif evidence.corners > 0.3:
            yield _Point(-4.0, f"{100 * evidence.corners:.0f} % of the corners have depth")


def _by_infrared(camera: Camera, evidence: Evidence) -> Iterator[_Point]:
    counts = evidence.infrared
    if counts is None:
        return
    bits = 8 if counts <= _IMAGER_COUNTS else 16
    fits = camera.infrared_bits == bits
    yield _Point(1.0 if fits else -1.0, f"there is infrared, up to {counts:.0f} counts")
