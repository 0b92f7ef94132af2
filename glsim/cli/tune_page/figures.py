"""Figures of the shown frame and of a recording, measured as in ``glsim compare``."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from glsim.core.array_types import Floats
from glsim.core.depth_frame import Frames
from glsim.core.depth_map import FLYING_MM
from glsim.core.reason import Reason
from glsim.core.units import to_mm
from glsim.data.maps import open_maps
from glsim.measures.correlation import correlation_of, lagged_sums
from glsim.measures.depth_noise import measure_spatial
from glsim.measures.silhouettes import find_edges, measure_silhouettes
from glsim.measures.validity import measure_invalid
from glsim.simulation.frame import Frame

#: Number of measured frames of the recording. Chosen: the page waits for the measurement.
_RECORDED = 16
#: Pixels up to this distance behind the nearest point count as the face, mm: the depth of a head.
_FACE_MM = 250.0
#: Width of the bins of distance and of angle, and smallest number of pixels in a bin.
_DISTANCE_MM, _ANGLE_DEG, _LEAST = 20.0, 10.0, 30
_BINS, _LAGS = 40, 8


def frame_figures(frame: Frame) -> dict[str, Any]:
    """Compute the figures of a frame as JSON values; None for too few pixels.

    Errors are noisy minus clean depth, mm, of pixels with both, without flying pixels. Sigma is
    their standard deviation about the mean of a bin on the face.

    Args:
        frame: with the layer ``normal``, (h, w, 4) in the camera's axes.
    """
    clean, noisy = to_mm(frame.clean_m), to_mm(frame.noisy_m)
    both = (clean > 0) & (noisy > 0)
    error = np.where(both, noisy - clean, np.float32(0))
    same = both & (np.abs(error) <= FLYING_MM)
    nearest = float(clean[clean > 0].min()) if (clean > 0).any() else 0.0
    face = same & (clean < nearest + _FACE_MM)
    angle = np.degrees(np.arccos(np.clip(-frame.extra["normal"][..., 2], 0.0, 1.0)))
    values = error[same]
    return {
        "surface_px": int((clean > 0).sum()),
        "measured_px": int(both.sum()),
        "bias_mm": _number(values.mean() if values.size else math.nan),
        "face_sigma_mm": _number(error[face].std() if face.sum() > 1 else math.nan),
        "distance": _by(clean[face], error[face], _DISTANCE_MM),
        "angle": _by(angle[face], error[face], _ANGLE_DEG),
        "histogram": _histogram(values, frame.depth_unit_mm),
        "autocorrelation": _autocorrelation(error, face),
        "reasons": _reasons(frame),
        "silhouettes": _silhouettes(frame),
    }


def _silhouettes(frame: Frame) -> dict[str, Any]:
    """Measure the gaps beside silhouettes as in ``glsim compare``, px."""
    edges = find_edges(frame.measured())
    sides = {}
    for number, side in enumerate(("left", "right")):
        own = edges.side == number
        width = np.median(edges.width[own]) if own.sum() >= 5 else math.nan
        sides[side] = {"edges": int(own.sum()), "width_px": _number(width)}
    return sides


def recording_figures(folder: Path) -> dict[str, Any]:
    """Measure a recording. Raises ConfigError or DatasetError if it is not readable."""
    return _compared(open_maps(folder).read(_RECORDED))


def tuned_figures(frame: Frame) -> dict[str, Any]:
    """Measure a tuned frame in the same way as ``recording_figures``."""
    return _compared(Frames.of([frame.measured()], "tuned"))


def _compared(frames: Frames) -> dict[str, Any]:
    spatial = measure_spatial(frames)
    sides = measure_silhouettes(frames)
    rough = spatial.rough_mm
    rows: list[tuple[str, str, float]] = [
        ("residual in 7x7 px, 10th percentile", "mm", rough[0]),
        ("residual in 7x7 px, median", "mm", rough[1]),
        ("residual in 7x7 px, 90th percentile", "mm", rough[2]),
        ("correlation to the next pixel", "", spatial.correlation[0]),
        ("silhouette width, left", "px", sides.left.width_px),
        ("silhouette width, right", "px", sides.right.width_px),
        ("without depth beside it, left", "px", sides.left.invalid_px),
        ("without depth beside it, right", "px", sides.right.invalid_px),
        ("without depth, image centre", "%", 100 * measure_invalid(frames)[0][2]),
    ]
    return {
        "title": frames.title,
        "frames": len(frames),
        "rows": [[name, unit, _number(value)] for name, unit, value in rows],
    }


def _number(value: float) -> float | None:
    return round(float(value), 4) if math.isfinite(value) else None


def _by(at: Floats, error: Floats, width: float) -> list[list[float]]:
    """Return [middle of the bin, standard deviation of the error, pixels] for each full bin."""
    if not at.size:
        return []
    bins = np.floor(at / width).astype(int)
    first = int(bins.min())
    bins = bins - first
    exact = error.astype(np.float64)
    count = np.bincount(bins)
    total, squares = np.bincount(bins, exact), np.bincount(bins, exact**2)
    return [
        [
            (n + first + 0.5) * width,
            round(math.sqrt(max(squares[n] / count[n] - (total[n] / count[n]) ** 2, 0.0)), 4),
            int(count[n]),
        ]
        for n in range(len(count))
        if count[n] >= _LEAST
    ]


def _histogram(values: Floats, unit_mm: float) -> dict[str, Any]:
    """Count errors in bins within four robust deviations; outliers go to the last bins.

    Bins are whole depth units wide; with other widths, every third bin might be empty.
    """
    if values.size < _LEAST:
        return {"low_mm": -1.0, "high_mm": 1.0, "counts": []}
    middle = float(np.median(values))
    spread = 1.4826 * float(np.median(np.abs(values - middle)))  # sigma of a Gaussian
    reach = max(4 * spread, 0.5)
    width = unit_mm * max(round(2 * reach / unit_mm / _BINS), 1)
    sides = max(math.ceil(reach / width), 2)
    reach = round((sides + 0.5) * width, 6)
    inside = np.clip(values.astype(np.float64), -reach, reach)
    counts, _ = np.histogram(inside, bins=2 * sides + 1, range=(-reach, reach))
    return {"low_mm": -reach, "high_mm": reach, "counts": counts.tolist()}


def _autocorrelation(error: Floats, mask: NDArray[np.bool_]) -> dict[str, Any]:
    """Correlate errors with errors 0 to 8 pixels to the right, and 0 to 8 pixels below."""
    if mask.sum() < _LEAST:
        return {"row": [], "column": []}
    noise = np.where(mask, error - error[mask].mean(), np.nan).astype(np.float64)
    steps = range(_LAGS + 1)
    return {
        name: [_number(c) for c in correlation_of([lagged_sums(noise, lags)])]
        for name, lags in (("row", [(0, k) for k in steps]), ("column", [(k, 0) for k in steps]))
    }


def _reasons(frame: Frame) -> list[list[Any]]:
    """Count pixels on a surface by reason: [name, help, pixels, share of the surface]."""
    surface = frame.clean_m > 0
    whole = max(int(surface.sum()), 1)
    counts = np.bincount(frame.reason_codes[surface], minlength=len(Reason))
    rows = [
        [r.name.lower(), r.help, int(counts[r]), round(int(counts[r]) / whole, 5)]
        for r in Reason
        if counts[r] and r is not Reason.VALID
    ]
    return sorted(rows, key=lambda row: -row[2])
