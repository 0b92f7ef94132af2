"""Training of depth denoisers on simulated pairs: networks, losses, recipes, data, loop.

    from glsim.train import fit, load_recipe, stored_batches
    recipe = load_recipe("face")
    fit(recipe, stored_batches([Path("data")], recipe), Path("runs/mine"))

Installed as ``glsim.train``. The names below are the public API; each is imported when it is first
used, so that ``import glsim.train`` loads no PyTorch.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from glsim.train.batches import simulated_batches, stored_batches
    from glsim.train.data.simulated import SimulatedPairs, randomised
    from glsim.train.data.stored import Augmentation, StoredPairs
    from glsim.train.loop import fit
    from glsim.train.losses import build_loss
    from glsim.train.models.registry import build_model
    from glsim.train.recipe import Recipe, load_recipe, recipe_names

#: Module -> its public names.
_NAMES = {
    "glsim.train.batches": "simulated_batches stored_batches",
    "glsim.train.data.simulated": "SimulatedPairs randomised",
    "glsim.train.data.stored": "Augmentation StoredPairs",
    "glsim.train.loop": "fit",
    "glsim.train.losses": "build_loss",
    "glsim.train.models.registry": "build_model",
    "glsim.train.recipe": "Recipe load_recipe recipe_names",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}

__all__ = [
    "Augmentation", "Recipe", "SimulatedPairs", "StoredPairs", "build_loss", "build_model", "fit",
    "load_recipe", "randomised", "recipe_names", "simulated_batches", "stored_batches",
]  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name from its module at its first use."""
    if name not in _HOME:
        raise AttributeError(f"module 'glsim.train' has no attribute {name!r}")
    return getattr(importlib.import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    """Return the public names, for completion in an interpreter."""
    return __all__
