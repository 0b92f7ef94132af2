"""Classifier of two sets of patches on fixed features: logistic regression and trees, with AUC.

Trees also see differences of spread and of combinations of features. AUC is the probability that a
patch of the second set scores higher than a patch of the first; 0.5 means indistinguishable. Both
sets give equally many patches from each eighth of the distances (or of S), so that the classifier
does not learn the scene.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.bench.compare.patches import Patches
from glsim.core.array_types import Array

_FOLDS = 5
_STRATA = 8
#: Number of boosted trees, and depth of each tree. Chosen: training on 10,000 patches takes 1 s.
_TREES, _TREE_DEPTH = 80, 4
#: Larger standardised features are clipped, so that no single patch decides. Chosen, not measured.
_CUT = 4.0
#: Smallest number of matched patches per set for which an AUC is computed: four in each fold.
LEAST_PATCHES = 20
#: Number of features listed in a verdict.
_LISTED = 3
#: AUC of the regression, AUC of the trees, standard error of the first, of the second.
_Aucs = tuple[float, float, float, float]
_UNKNOWN: _Aucs = (math.nan, math.nan, math.nan, math.nan)


@dataclass(frozen=True)
class TellingFeature:
    """A feature whose values differ between the sets.

    Attributes:
        auc: AUC of this feature alone, 0.5 to 1.
        first, second: median of the feature in the first and in the second set.
        apart: difference of the medians, divided by the mean of the two interquartile ranges.
    """

    feature: str
    auc: float
    first: float
    second: float
    apart: float


@dataclass(frozen=True)
class Verdict:
    """Result of the classifier on one kind of patches.

    Attributes:
        auc: AUC of the logistic regression, mean over five folds; NaN with too few patches.
        auc_error, boosted_auc_error: standard errors of both, from the spread over the folds.
        patches: number of matched patches in each set.
        telling: the features whose medians differ most.
    """

    auc: float
    boosted_auc: float
    auc_error: float
    boosted_auc_error: float
    patches: int
    telling: tuple[TellingFeature, ...]


def tell_apart(
    first: Patches, second: Patches, first_views: Sequence[int] | None = None,
    second_views: Sequence[int] | None = None,
) -> Verdict:  # fmt: skip
    """Train a classifier to distinguish the patches of two sets; its verdict is reproducible.

    Views are the view numbers of frames, equal in a static recording. Default: all differ.
    """
    a, b = _matched(first.matched, second.matched)
    if min(len(a), len(b)) < LEAST_PATCHES:
        return Verdict(*_UNKNOWN, min(len(a), len(b)), ())
    x = np.concatenate([first.features[a], second.features[b]])
    label = np.concatenate([np.zeros(len(a)), np.ones(len(b))])
    fold = np.concatenate([_folds(first, first_views)[a], _folds(second, second_views)[b]])
    aucs = _cross_validated(x, label, fold)
    tells = [_telling(name, x[:, k], label) for k, name in enumerate(first.names)]
    tells.sort(key=lambda t: -abs(t.apart))
    return Verdict(*aucs, len(a), tuple(tells[:_LISTED]))


def _cross_validated(x: Array, label: Array, fold: NDArray[np.int64]) -> _Aucs:
    """Cross-validate the regression and the trees; return both mean AUCs and standard errors."""
    from sklearn.ensemble import HistGradientBoostingClassifier
    from sklearn.linear_model import LogisticRegression
    from sklearn.metrics import roc_auc_score
    from sklearn.model_selection import PredefinedSplit
    from sklearn.preprocessing import StandardScaler
    from threadpoolctl import threadpool_limits

    scored = []
    for train, test in PredefinedSplit(fold).split():
        if len(np.unique(label[test])) < 2 or len(np.unique(label[train])) < 2:
            continue
        scaler = StandardScaler().fit(x[train])
        design = np.clip(scaler.transform(x), -_CUT, _CUT)
        trees = HistGradientBoostingClassifier(
            max_iter=_TREES, max_depth=_TREE_DEPTH, early_stopping=False, random_state=0
        )
        with threadpool_limits(1):  # on a busy machine threads wait for each other
            line = LogisticRegression(max_iter=1000).fit(design[train], label[train])
            trees.fit(x[train], label[train])
            scores = line.decision_function(design[test]), trees.decision_function(x[test])
        scored.append([float(roc_auc_score(label[test], s)) for s in scores])
    if len(scored) < 2:
        return _UNKNOWN
    linear, boosted = np.mean(scored, axis=0).tolist()
    linear_error, boosted_error = (np.std(scored, axis=0, ddof=1) / np.sqrt(len(scored))).tolist()
    return linear, boosted, linear_error, boosted_error


def _telling(name: str, values: Array, label: Array) -> TellingFeature:
    from sklearn.metrics import roc_auc_score

    single = float(roc_auc_score(label, values))
    quarters = [np.percentile(values[label == k], (25, 50, 75)) for k in (0, 1)]
    spread = 0.5 * sum(q[2] - q[0] for q in quarters)
    first, second = (float(q[1]) for q in quarters)
    apart = (second - first) / max(float(spread), 1e-9)
    return TellingFeature(name, max(single, 1.0 - single), first, second, apart)


def _folds(patches: Patches, views: Sequence[int] | None) -> NDArray[np.int64]:
    """Assign a fold to each patch; a fold has successive views, since these show the same scene.

    The frames of a static recording repeat its fixed noise, so all belong to one view. With fewer
    than five views, each view is cut into five bands of columns.
    """
    view = patches.frame if views is None else np.asarray(views, np.int64)[patches.frame]
    group = view
    if len(np.unique(view)) < _FOLDS:
        last = int(patches.column.max(initial=0)) + 1
        group = view * _FOLDS + patches.column * _FOLDS // last
    order = np.unique(group)
    rank: NDArray[np.int64] = np.searchsorted(order, group)
    return rank * _FOLDS // max(len(order), 1)


def _matched(first: Array, second: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Choose equal numbers of patches from both sets in each eighth of the pooled values."""
    chosen: tuple[list[NDArray[np.int64]], ...] = ([np.zeros(0, np.int64)], [np.zeros(0, np.int64)])
    if first.size and second.size:
        pooled = np.concatenate([first, second])
        bounds = np.quantile(pooled, np.linspace(0, 1, _STRATA + 1)[1:-1])
        strata = [np.searchsorted(bounds, values) for values in (first, second)]
        for number in range(_STRATA):
            members = [np.flatnonzero(s == number) for s in strata]
            count = min(len(m) for m in members)
            for indices, m in zip(chosen, members, strict=True):
                indices.append(m[np.linspace(0, len(m) - 1, count).round().astype(int)])
    return np.concatenate(chosen[0]), np.concatenate(chosen[1])
