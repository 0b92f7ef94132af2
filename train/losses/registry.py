"""Losses by name: what the ``[loss]`` table of a recipe builds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from glsim.core.errors import ConfigError, did_you_mean
from glsim.settings.tables import parse_table
from glsim.train.losses.base import Loss
from glsim.train.losses.self_supervised import Recorrupted
from glsim.train.losses.supervised import AllPixels, Masked

LOSSES: Final[dict[str, type[Loss]]] = {
    "all_pixels": AllPixels,
    "masked": Masked,
    "recorrupted": Recorrupted,
}


def build_loss(table: Mapping[str, Any]) -> Loss:
    """Build the loss of a [loss] table. Raises ConfigError for an unknown kind or parameter."""
    kind = table.get("kind")
    if kind not in LOSSES:
        raise ConfigError(f"loss: no such kind {kind!r} ({did_you_mean(str(kind), LOSSES)})")
    return parse_table(LOSSES[kind], table, "loss")
