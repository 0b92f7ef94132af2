"""The public names of the training, and what importing them loads."""

from __future__ import annotations

import pytest

from glsim import train
from tests.support.imports import loaded_after


def test_the_package_alone_is_light() -> None:
    loaded = loaded_after("import glsim.train, glsim.train.data")
    assert not loaded & {"torch", "lightning_fabric", "cv2", "moderngl", "numpy"}
    assert "torch" not in loaded_after("from glsim.train import load_recipe, recipe_names")


def test_public_names_exist() -> None:
    assert set(train.__all__) == set(train._HOME)
    for name in train.__all__:
        assert getattr(train, name).__module__ == train._HOME[name]
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = train.nothing
