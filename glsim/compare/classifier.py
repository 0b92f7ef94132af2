"""Tell two sets of patches apart: logistic regression on fixed features, and its AUC.

AUC: the probability that a patch of the second set scores higher than one of the first; 0.5 =
indistinguishable. Patches are first matched: in each eighth of the matched quantity (distance, or
S) both sets give equally many, so that another scene or distance does not tell them apart. The
regression is fitted by Newton's method (iteratively reweighted least squares; McCullagh and Nelder
1989) with a ridge of 1, on four fifths of the frames, and scored on the rest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.compare.patches import Patches

Array = NDArray[np.float64]

_FOLDS = 5
_STRATA = 8
_RIDGE = 1.0
_NEWTON_STEPS = 15
#: Standardised features are cut here, so that single patches do not decide.
_CUT = 4.0
#: Patches of each set after matching that an AUC needs: its error is then about 0.03.
LEAST_PATCHES = 120
_TOLD = 3


@dataclass(frozen=True)
class Telling:
    """A feature that tells the sets apart: its own AUC (0.5 to 1) and its mean in each set."""

    feature: str
    auc: float
    first: float
    second: float


@dataclass(frozen=True)
class Verdict:
    """auc: cross-validated by frame, NaN with too few patches. patches: of each set, matched."""

    auc: float
    patches: int
    telling: tuple[Telling, ...]


def tell_apart(first: Patches, second: Patches) -> Verdict:
    """Classify the patches of two sets. Same patches, same verdict: nothing is drawn at random."""
    a, b = _matched(first.matched, second.matched)
    if min(len(a), len(b)) < LEAST_PATCHES:
        return Verdict(float("nan"), min(len(a), len(b)), ())
    x = np.concatenate([first.features[a], second.features[b]])
    label = np.concatenate([np.zeros(len(a)), np.ones(len(b))])
    fold = np.concatenate([_folds(first.frame)[a], _folds(second.frame)[b]])
    scores = np.full(len(label), np.nan)
    scored: list[float] = []
    for number in range(_FOLDS):
        test = fold == number
        train = ~test
        if not (label[test] == 0).any() or not (label[test] == 1).any():
            continue
        centre, spread = x[train].mean(axis=0), np.maximum(x[train].std(axis=0), 1e-9)
        design = np.clip((x - centre) / spread, -_CUT, _CUT)
        weights = fit_logistic(design[train], label[train])
        scores[test] = weights[0] + design[test] @ weights[1:]
        scored.append(area_under_curve(scores[test], label[test]))
    tells = []
    for k, name in enumerate(first.names):
        single = area_under_curve(x[:, k], label)
        means = float(x[label == 0, k].mean()), float(x[label == 1, k].mean())
        tells.append(Telling(name, max(single, 1.0 - single), *means))
    tells.sort(key=lambda t: -t.auc)
    auc = float(np.mean(scored)) if scored else float("nan")
    return Verdict(auc, len(a), tuple(tells[:_TOLD]))


def fit_logistic(design: Array, label: Array) -> Array:
    """Fit (1 + F,) weights, the constant first, of log odds = w0 + design w; a ridge on w."""
    x = np.column_stack([np.ones(len(design)), design])
    ridge = np.full(x.shape[1], _RIDGE)
    ridge[0] = 1e-6
    weights = np.zeros(x.shape[1])
    for _ in range(_NEWTON_STEPS):
        p = 1.0 / (1.0 + np.exp(-np.clip(x @ weights, -30, 30)))
        gradient = x.T @ (label - p) - ridge * weights
        curvature = (x * np.maximum(p * (1 - p), 1e-6)[:, None]).T @ x + np.diag(ridge)
        step = np.linalg.solve(curvature, gradient)
        weights = weights + np.clip(step, -5.0, 5.0)
        if np.abs(step).max() < 1e-8:
            break
    return weights


def area_under_curve(score: Array, label: Array) -> float:
    """Compute the AUC by ranks (Mann and Whitney); ties count half."""
    ones = int((label == 1).sum())
    zeros = len(label) - ones
    if ones == 0 or zeros == 0:
        return float("nan")
    _, place, counts = np.unique(score, return_inverse=True, return_counts=True)
    rank = (np.cumsum(counts) - 0.5 * (counts - 1))[place]
    return float((rank[label == 1].sum() - ones * (ones + 1) / 2) / (ones * zeros))


def _folds(frame: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number the folds by runs of frames: neighbours in time share a scene.

    A single frame is split into fifths of its patches.
    """
    order = np.unique(frame)
    if len(order) < 2:
        return np.arange(frame.size) * _FOLDS // max(frame.size, 1)
    place: NDArray[np.int64] = np.searchsorted(order, frame)
    return place * _FOLDS // len(order)


def _matched(first: Array, second: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Choose equally many of both sets in each eighth of the pooled values."""
    if first.size == 0 or second.size == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    pooled = np.concatenate([first, second])
    bounds = np.quantile(pooled, np.linspace(0, 1, _STRATA + 1)[1:-1])
    chosen: tuple[list[NDArray[np.int64]], list[NDArray[np.int64]]] = ([], [])
    strata = [np.searchsorted(bounds, values) for values in (first, second)]
    for number in range(_STRATA):
        members = [np.flatnonzero(s == number) for s in strata]
        count = min(len(m) for m in members)
        for part, m in zip(chosen, members, strict=True):
            if count:
                part.append(m[np.linspace(0, len(m) - 1, count).round().astype(int)])
    if not chosen[0]:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    return np.concatenate(chosen[0]), np.concatenate(chosen[1])
