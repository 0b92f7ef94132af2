"""What is loaded when, the public names, and that shaders and sensors are complete."""

from __future__ import annotations

import importlib.metadata
import os
import subprocess
import sys
from pathlib import Path

import moderngl
import pytest

import glsim
from glsim.gl.includes import SHADER_ROOT
from glsim.gl.shader_source import load_source
from glsim.noise.numpy_twins import TWINS
from glsim.noise.registry import shipped_stages
from glsim.sensors.sensor import SENSOR_FOLDER, load_sensor
from tests.support.imports import ROOT, loaded_after

LOADED_LAZILY = {"torch", "cv2", "skimage", "moderngl", "trimesh", "typer", "rich", "numpy"}


def test_importing_glsim_loads_nothing_heavy() -> None:
    assert not loaded_after("import glsim") & LOADED_LAZILY


def test_planning_needs_no_opengl() -> None:
    """Settings, sensors and their stages are text."""
    code = "import glsim; glsim.load_settings(); glsim.sensor_names()"
    assert not loaded_after(code) & {"torch", "cv2", "skimage", "trimesh"}


def test_recipes_and_commands_need_no_pytorch() -> None:
    loaded = loaded_after("import glsim.cli, glsim.train.recipe")
    assert not loaded & {"torch", "lightning_fabric", "cv2", "moderngl"}


def test_scoring_needs_no_figures_and_no_networks() -> None:
    loaded = loaded_after("import glsim.eval.scoring.run, glsim.eval.report.tables")
    assert not loaded & {"torch", "matplotlib", "skimage", "scipy"}


def test_the_command_line_stays_light() -> None:
    loaded = loaded_after("import glsim.cli")
    assert not loaded & {"torch", "matplotlib", "cv2", "moderngl", "glsim.eval.metrics"}


def test_public_names_exist() -> None:
    assert set(glsim.__all__) == set(glsim._HOME)
    for name in glsim.__all__:
        assert getattr(glsim, name) is not None
    assert glsim.__version__ == importlib.metadata.version("glsim")
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = glsim.nothing


SHADERS = [p for p in sorted(SHADER_ROOT.rglob("*")) if p.suffix in (".glsl", ".vert", ".frag")]


@pytest.mark.parametrize("file", SHADERS, ids=lambda f: str(f.relative_to(SHADER_ROOT)))
def test_every_shader_starts_with_its_name_and_purpose(file: Path) -> None:
    lines = file.read_text().splitlines()
    assert lines[0] == "#version 330 core" or file.parent.name == "lib"
    title = lines[0 if file.parent.name == "lib" else 1]
    assert title.startswith(f"// {file.stem}: ")
    assert load_source(file).text


def test_every_shader_stage_has_a_twin() -> None:
    shaders = {name for name, spec in shipped_stages().items() if spec.source is not None}
    assert set(TWINS) == shaders


@pytest.mark.parametrize("file", sorted(SENSOR_FOLDER.glob("*.toml")), ids=lambda f: f.stem)
def test_every_sensor_loads_by_name_and_by_path(file: Path) -> None:
    sensor = load_sensor(file.stem)
    assert sensor.title
    assert sensor.describe() == load_sensor(str(file)).describe()


def test_the_renderer_is_the_expected_one(context: moderngl.Context) -> None:
    """CI says which with GLSIM_EXPECT_RENDERER, so that a changed image is noticed."""
    expected = os.environ.get("GLSIM_EXPECT_RENDERER", "")
    assert expected.lower() in str(context.info["GL_RENDERER"]).lower()
    assert context.version_code >= 330


def test_a_checkout_that_is_not_installed_says_so() -> None:
    """Without site-packages, as after a download: train, eval and shaders lie beside glsim."""
    done = subprocess.run(
        [sys.executable, "-S", "-m", "glsim", "info"],
        cwd=ROOT, capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert done.stderr == (
        "glsim: error: glsim is not installed: run pip install -e . in its folder\n"
    )
