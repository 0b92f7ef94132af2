"""What is loaded when, the public names, and that shaders and sensors are complete."""

from __future__ import annotations

import importlib.metadata
import os

import moderngl
import pytest

import glsim
from glsim.sensors.sensor import load_sensor, sensor_file, sensor_names
from tests.support.imports import loaded_after


@pytest.mark.parametrize(
    ("code", "not_loaded"),
    [
        ("import glsim", {"torch", "cv2", "moderngl", "trimesh", "typer", "rich", "numpy"}),
        ("import glsim; glsim.load_settings()", {"torch", "cv2", "trimesh"}),
        ("import glsim.cli, glsim.train.recipe", {"torch", "cv2", "moderngl", "matplotlib"}),
        ("import glsim.eval.scoring.evaluate", {"torch", "matplotlib"}),
        ("import glsim.train, glsim.train.data", {"torch", "lightning_fabric", "cv2", "numpy"}),
        ("from glsim.train import load_recipe, recipe_names", {"torch"}),
    ],
)
def test_nothing_heavy_is_loaded_early(code: str, not_loaded: set[str]) -> None:
    assert not loaded_after(code) & not_loaded


def test_public_names_exist() -> None:
    for name in glsim.__all__:
        assert getattr(glsim, name) is not None
    assert glsim.__version__ == importlib.metadata.version("glsim")
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = glsim.nothing


@pytest.mark.parametrize("name", sensor_names())
def test_every_sensor_loads_by_name_and_by_path(name: str) -> None:
    assert load_sensor(name).describe() == load_sensor(str(sensor_file(name))).describe()


def test_the_renderer_is_the_expected_one(context: moderngl.Context) -> None:
    """CI says which with GLSIM_EXPECT_RENDERER, so that a changed image is noticed."""
    expected = os.environ.get("GLSIM_EXPECT_RENDERER", "")
    assert expected.lower() in str(context.info["GL_RENDERER"]).lower()
