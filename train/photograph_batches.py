"""Batches of photographs in the depth range of a data set, see ``glsim.train.batches``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np
from torch.utils.data import Subset

from glsim.errors import ConfigError
from glsim.train.batches import StoredBatches, stored_batches
from glsim.train.data.checks import fingerprint
from glsim.train.data.photograph_files import (
    find_photographs,
    read_photographs,
    split_photographs,
)
from glsim.train.data.photographs import PhotographPairs, measure_span, photograph_fingerprint
from glsim.train.models.registry import inputs_of
from glsim.train.recipe import Recipe

#: Standard deviation of the noise, grey levels of 255: the middle one of the levels 15, 25 and 50
#: at which denoisers of photographs are compared (Zhang et al., DnCNN, 2017).
DEFAULT_SIGMA_GREY: Final = 25.0
#: Clean maps from which the range of depths is measured: medians need no more.
_MEASURED: Final = 64
#: Pairs of held-out photographs, unless the recipe gives a number of validation frames.
_VALIDATION_PAIRS: Final = 100


def photograph_batches(
    place: str, sigma_grey: float, datasets: Sequence[Path], recipe: Recipe
) -> StoredBatches:
    """Open photographs as the training data of a recipe.

    Args:
        place: a folder of photographs, or ``scikit-image`` for those of that package.
        sigma_grey: standard deviation of the noise, grey levels of 255.
        datasets: data sets that give the range of depths of the grey levels, and the number of
            pairs per epoch.
        recipe: the training.

    Raises:
        ConfigError: for a recipe without a crop or with further inputs; without photographs.
        DatasetError: for a damaged data set or photograph.
    """
    crop = recipe.data.crop
    if not crop:
        raise ConfigError("--photos: set data.crop, the side of the parts of the photographs")
    if inputs_of(recipe.model).channels > 1:
        raise ConfigError("--photos: photographs have depth alone, and this network takes more")
    pairs = stored_batches(datasets, _as_stored(recipe)).training_pairs
    at = np.linspace(0, len(pairs) - 1, min(_MEASURED, len(pairs))).round().astype(int)
    span = measure_span(pairs[int(n)][1] for n in at)
    photographs = read_photographs(find_photographs(place), crop)
    train, held_out = (
        PhotographPairs(part, span, sigma_grey, side=crop, length=length, seed=seed)
        for part, length, seed in zip(
            split_photographs(photographs),
            (len(pairs), recipe.data.validation_frames or _VALIDATION_PAIRS),
            (recipe.seed, 0),
            strict=True,
        )
    )
    marks = photograph_fingerprint(photographs, span, sigma_grey)
    marks["depths_of"] = [fingerprint(path)["manifest_crc32"] for path in datasets]
    return StoredBatches(train, Subset(held_out, range(len(held_out))), marks, recipe)


def _as_stored(recipe: Recipe) -> Recipe:
    """Return the recipe without augmentation and with seed 0, so that all seeds map depth alike."""
    data = {"flip": False, "relief_mm": 0.0, "slope_mm_per_px": 0.0}
    stored = recipe.data.model_copy(update=data)
    return recipe.model_copy(update={"seed": 0, "data": stored})
