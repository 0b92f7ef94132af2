"""The metrics of a frame, in the order of the columns of rows.csv."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Final

import numpy as np

from glsim.core.depth_map import BAND_PX, FLYING_MM
from glsim.eval.metrics.form import relief_kept_pct
from glsim.eval.metrics.metric import Direction, Metric
from glsim.eval.metrics.scored_map import PSNR_MAX_MM, ScoredMap, psnr_db
from glsim.eval.metrics.ssim import PRESETS

#: A normal counts as good if its error is smaller than this angle, degrees.
_GOOD_DEG: Final = 10.0


def _share(part: float, whole: float) -> float:
    return part / whole if whole else math.nan


def _angle(prediction: ScoredMap, of: Callable[..., float]) -> float:
    angle, _ = prediction.angles
    return float(of(angle)) if angle.size else math.nan


#: Definitions of sets of pixels; ``_SETS``: (base, part) of ``ScoredMap.errors`` -> definition.
_BOTH: Final = "prediction and clean valid"
_INPUT: Final = (
    "input and clean valid, the same pixels for every method; where the method has no "
    "depth its input's stands in"
)
_INTERIOR: Final = f", more than {BAND_PX} px from an edge of the clean map"
_EDGE: Final = f", at most {BAND_PX} px from an edge of the clean map"
_SETS: Final = {
    ("both", "all"): _BOTH,
    ("both", "interior"): _BOTH + _INTERIOR,
    ("both", "edge"): _BOTH + _EDGE,
    ("input", "all"): _INPUT,
    ("input", "interior"): _INPUT + _INTERIOR,
    ("input", "edge"): _INPUT + _EDGE,
    ("filled", "all"): "prediction and clean valid, input not",
}
#: Statistics of the error (prediction - clean): key -> (better direction, definition).
_STATISTICS: Final[dict[str, tuple[Direction, str]]] = {
    "rmse": ("lower", "root mean square error"),
    "mae": ("lower", "mean absolute error"),
    "median": ("lower", "median absolute error"),
    "p95": ("lower", "95th percentile of the absolute error"),
    "bias": ("neither", "mean error, positive is too far"),
}
_DEPTH_IN_TABLE: Final = (
    *("both_rmse_mm", "input_rmse_mm", "input_interior_rmse_mm", "both_edge_rmse_mm"),
    *("filled_rmse_mm", "input_bias_mm"),
)


def _depth_metric(base: str, part: str, key: str) -> Metric:
    better, words = _STATISTICS[key]
    name = f"{base}_{key}_mm" if part == "all" else f"{base}_{part}_{key}_mm"
    text = f"{words} where {_SETS[base, part]}"
    return Metric(
        name, "mm", better, "depth", text, lambda p: p.statistics(base, part)[key],
        name in _DEPTH_IN_TABLE,
    )  # fmt: skip


SHIPPED_METRICS: Final = (
    Metric("mse_mm2", "mm²", "lower", "paper", "mean squared error over all pixels, holes = 0",
           lambda p: p.mse_mm2, in_table=True),
    Metric("psnr_db", "dB", "higher", "paper",
           f"10 log10({PSNR_MAX_MM:.0f}² / MSE) of the frame; undefined for MSE 0",
           lambda p: psnr_db(p.mse_mm2), in_table=True),
    Metric("mse_flips_pct", "%", "neither", "paper",
           "share of the squared error that is in pixels valid in one of both only",
           lambda p: 100.0 * _share(float(p.squared[p.valid != p.truth.valid].sum())
                                    / p.squared.size, p.mse_mm2), in_table=True),
    *(
        Metric(f"ssim_{name}", "1", "higher", "paper", f"structural similarity, {preset}",
               partial(lambda key, p: p.ssim[key], name), in_table=True)
        for name, preset in PRESETS.items()
    ),
    Metric("iou", "1", "higher", "validity", "valid in both / valid in either",
           lambda p: _share(p.counts[0], p.counts[0] + p.flips), in_table=True),
    Metric("precision", "1", "higher", "validity", "share of the predicted pixels that exist",
           lambda p: _share(p.counts[0], p.counts[1]), in_table=True),
    Metric("recall", "1", "higher", "validity", "share of the clean pixels that are predicted",
           lambda p: _share(p.counts[0], p.counts[2]), in_table=True),
    Metric("flips_px", "px", "lower", "validity", "pixels valid in one of both only",
           lambda p: float(p.flips), in_table=True),
    Metric("flying_px", "px", "lower", "validity",
           f"predicted more than {FLYING_MM:.0f} mm off, or where there is no surface",
           lambda p: float(np.count_nonzero(
               p.valid & (~p.truth.valid | (np.abs(p.error) > FLYING_MM)))), in_table=True),
    *(_depth_metric(base, part, key) for base, part in _SETS for key in _STATISTICS),
    Metric("relief_kept_pct", "%", "higher", "depth",
           "share of the clean relief of 4 to 8 px that is kept in the interior", relief_kept_pct,
           in_table=True),
    Metric("normal_mean_deg", "°", "lower", "normals", "mean angle between the normals",
           lambda p: _angle(p, np.mean), in_table=True),
    Metric("normal_median_deg", "°", "lower", "normals", "median angle between the normals",
           lambda p: _angle(p, np.median)),
    Metric("normal_good_pct", "%", "higher", "normals",
           f"normals that are less than {_GOOD_DEG:.0f}° off",
           lambda p: 100.0 * _angle(p, lambda angle: (angle < _GOOD_DEG).mean()), in_table=True),
    Metric("systematic_mm2", "mm²", "lower", "depth",
           "mean square of the error that two frames of one view share, in the interior: form that "
           "is lost, without noise; only in sequences whose clean maps are equal", in_table=True),
    Metric("time_ms", "ms", "lower", "time", "the denoiser's time for the frame, one core",
           in_table=True),
)  # fmt: skip
