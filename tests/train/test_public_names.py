"""The public names of the training, and what importing them loads."""

from __future__ import annotations

from tests.support.imports import loaded_after


def test_the_package_alone_is_light() -> None:
    loaded = loaded_after("import glsim.train, glsim.train.data")
    assert not loaded & {"torch", "lightning_fabric", "cv2", "moderngl", "numpy"}
    assert "torch" not in loaded_after("from glsim.train import load_recipe, recipe_names")
