"""The number format of a training: bfloat16 only where a processor or GPU computes in it.

Elsewhere PyTorch converts to float32 and back: two steps of ``face`` took 26.4 CPU s in bf16-mixed
and 9.7 in 32-true on a processor with AVX2 alone (measured, PyTorch 2.13).
"""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Final

import torch

from glsim.train.recipe import Precision, Recipe

_CPU_INFO: Final = Path("/proc/cpuinfo")
#: Instructions on bfloat16, as Linux names them: Intel and AMD (AVX-512, AMX), ARM.
_BFLOAT16: Final = {"avx512_bf16", "amx_bf16", "bf16"}


def computes_bfloat16() -> bool:
    """Return whether the GPU, or without one the processor, has instructions on bfloat16."""
    if torch.cuda.is_available():
        return bool(torch.cuda.is_bf16_supported(including_emulation=False))
    with suppress(OSError):
        for line in _CPU_INFO.read_text(encoding="ascii", errors="replace").splitlines():
            name, _, words = line.partition(":")
            if name.strip() in ("flags", "Features"):
                return not _BFLOAT16.isdisjoint(words.split())
    return False


def with_precision(recipe: Recipe, begun: Path | None) -> Recipe:
    """Return the recipe with a precision in the place of "auto".

    Args:
        recipe: the training.
        begun: recipe.json of the training that is resumed, whose precision is kept; None for a
            new one.
    """
    if recipe.training.precision != "auto":
        return recipe
    chosen: Precision = "bf16-mixed" if computes_bfloat16() else "32-true"
    with suppress(OSError, ValueError, KeyError, TypeError):  # a new training, or a damaged file
        if begun is not None:
            chosen = json.loads(begun.read_text(encoding="utf-8"))["training"]["precision"]
    training = recipe.training.model_copy(update={"precision": chosen})
    return recipe.model_copy(update={"training": training})
