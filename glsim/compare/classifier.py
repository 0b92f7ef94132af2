"""Tell two sets of patches apart by logistic regression on fixed features, and its AUC.

AUC is the probability that a patch of the second set scores higher than one of the first; 0.5 means
indistinguishable. Patches are first matched: in each eighth of the matched quantity (distance, or
S) both sets give equally many, so that another scene or distance does not tell them apart.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from glsim.compare.patches import Patches

Array = NDArray[np.float64]

_FOLDS = 5
_STRATA = 8
#: Standardised features are clipped here, so that single patches do not decide; chosen.
_CUT = 4.0
#: Patches of each set after matching that an AUC needs: its error is then about 0.03.
LEAST_PATCHES = 120
_TOLD = 3


@dataclass(frozen=True)
class TellingFeature:
    """A feature that tells the sets apart: its own AUC (0.5 to 1) and its mean in each set."""

    feature: str
    auc: float
    first: float
    second: float


@dataclass(frozen=True)
class Verdict:
    """The classifier's verdict on one kind of patches.

    Attributes:
        auc: mean over five folds of frames; NaN with too few patches.
        patches: number in each set, matched.
        telling: the features with the highest AUC of their own.

    """

    auc: float
    patches: int
    telling: tuple[TellingFeature, ...]


def tell_apart(first: Patches, second: Patches) -> Verdict:
    """Classify the patches of two sets. Same patches, same verdict: nothing is drawn at random."""
    from sklearn.linear_model import LogisticRegression
    from sklearn.metrics import roc_auc_score
    from sklearn.model_selection import PredefinedSplit
    from sklearn.preprocessing import StandardScaler

    a, b = _matched(first.matched, second.matched)
    if min(len(a), len(b)) < LEAST_PATCHES:
        return Verdict(float("nan"), min(len(a), len(b)), ())
    x = np.concatenate([first.features[a], second.features[b]])
    label = np.concatenate([np.zeros(len(a)), np.ones(len(b))])
    fold = np.concatenate([_folds(first.frame)[a], _folds(second.frame)[b]])
    scored = []
    for train, test in PredefinedSplit(fold).split():
        if len(np.unique(label[test])) == 2:
            scaler = StandardScaler().fit(x[train])
            design = np.clip(scaler.transform(x), -_CUT, _CUT)
            model = LogisticRegression(max_iter=1000).fit(design[train], label[train])
            score = model.decision_function(design[test])
            scored.append(float(roc_auc_score(label[test], score)))
    tells = []
    for k, name in enumerate(first.names):
        single = float(roc_auc_score(label, x[:, k]))
        means = float(x[label == 0, k].mean()), float(x[label == 1, k].mean())
        tells.append(TellingFeature(name, max(single, 1.0 - single), *means))
    tells.sort(key=lambda t: -t.auc)
    auc = float(np.mean(scored)) if scored else float("nan")
    return Verdict(auc, len(a), tuple(tells[:_TOLD]))


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
