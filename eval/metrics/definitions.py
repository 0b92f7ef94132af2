"""The metrics of a frame, in the order of the columns of rows.csv; metrics.toml describes them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

import numpy as np

from glsim.core.depth_map import BAND_PX, FLYING_MM
from glsim.eval.metrics.form import WIDE_PX, hole_curvature_per_m, relief_kept_pct
from glsim.eval.metrics.metric import DESCRIPTIONS, Direction, Metric
from glsim.eval.metrics.scored_map import BESIDE_PX, PSNR_MAX_MM, ScoredMap, psnr_db
from glsim.eval.metrics.ssim import PRESETS

#: A normal counts as good if its error is smaller than this angle, degrees.
_GOOD_DEG: Final = 10.0


def _share(part: float, whole: float) -> float:
    return part / whole if whole else math.nan


def _angle(prediction: ScoredMap, of: Callable[..., float]) -> float:
    angle, _ = prediction.angles
    return float(of(angle)) if angle.size else math.nan


def _flips_pct(p: ScoredMap) -> float:
    in_flips = float(p.squared[p.valid != p.truth.valid].sum()) / p.squared.size
    return 100.0 * _share(in_flips, p.mse_mm2)


def _ring_lost_pct(p: ScoredMap) -> float:
    truth = p.truth
    right = truth.ring & truth.input_valid & (np.abs(truth.noisy - truth.clean) <= FLYING_MM)
    lost = right & (~p.valid | (np.abs(p.error) > FLYING_MM))
    return 100.0 * _share(float(lost.sum()), float(right.sum()))


def _harm_pct(p: ScoredMap) -> float:
    error, pixels = p.errors("input", "interior")
    before = p.truth.noisy[pixels] - p.truth.clean[pixels]
    return 100.0 * _share(float((np.abs(error) > np.abs(before)).sum()), error.size)


#: Name -> function. Without a function, ``score`` or its caller computes the metric.
_VALUES: Final[dict[str, Callable[[ScoredMap], float]]] = {
    "mse_mm2": lambda p: p.mse_mm2,
    "psnr_db": lambda p: psnr_db(p.mse_mm2),
    "mse_flips_pct": _flips_pct,
    "iou": lambda p: _share(p.counts[0], p.counts[0] + p.flips),
    "precision": lambda p: _share(p.counts[0], p.counts[1]),
    "recall": lambda p: _share(p.counts[0], p.counts[2]),
    "flips_px": lambda p: float(p.flips),
    "flying_px": lambda p: float(np.sum(p.valid & (~p.truth.valid | (abs(p.error) > FLYING_MM)))),
    "ring_lost_pct": _ring_lost_pct,
    "relief_kept_pct": relief_kept_pct,
    "relief_wide_kept_pct": partial(relief_kept_pct, band_px=WIDE_PX),
    "harm_pct": _harm_pct,
    "hole_curvature_per_m": hole_curvature_per_m,
    "normal_mean_deg": lambda p: _angle(p, np.mean),
    "normal_median_deg": lambda p: _angle(p, np.median),
    "normal_good_pct": lambda p: 100.0 * _angle(p, lambda angle: (angle < _GOOD_DEG).mean()),
}


def _shipped() -> Iterator[Metric]:
    numbers = {"psnr_max": PSNR_MAX_MM, "flying": FLYING_MM, "good": _GOOD_DEG}
    numbers |= {"band": BAND_PX, "beside": BESIDE_PX}
    for name, (unit, better, group, text) in DESCRIPTIONS["metrics"].items():
        made: dict[str, tuple[Direction, str, Any]] = {name: (better, text, _VALUES.get(name))}
        if name == "ssim":
            made = {
                f"ssim_{key}": (better, f"{text}, {preset}", partial(lambda k, p: p.ssim[k], key))
                for key, preset in PRESETS.items()
            }
        elif name == "depth":
            made = {
                f"{base}_{'' if part == 'all' else f'{part}_'}{key}_mm": (
                    way,
                    f"{words} where {where}{DESCRIPTIONS['parts'][part]}",
                    partial(lambda b, a, k, p: p.statistics(b, a)[k], base, part, key),
                )
                for base, where in DESCRIPTIONS["bases"].items()
                for part in DESCRIPTIONS["parts_of_bases"][base]
                for key, (way, words) in DESCRIPTIONS["statistics"].items()
            }
        for full, (way, help_, value) in made.items():
            in_table = full in DESCRIPTIONS["titles"]
            yield Metric(full, unit, way, group, help_.format(**numbers), value, in_table)


SHIPPED_METRICS: Final = tuple(_shipped())
