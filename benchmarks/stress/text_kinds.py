"""Inputs that people write: a sensor, settings, a recipe and a shader; read whole, not drawn."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.stress.damage import Kind, change_words
from tests.support import mutations

_SENSOR = """
title = "mine"
[rig]
width = 64
height = 48
focal_px = [60.0, 60.0]
centre_px = [32.0, 24.0]
supersample = 3
[rig.distortion]
k1 = 0.05
[[rig.emitter]]
position_m = [0.045, 0, 0]
[[stage]]
use = "shadow"
[[stage]]
use = "axial"
base_sigma_mm = { uniform = [1, 3], per = "sequence" }
[[stage]]
use = "despeckle"
min_area_px = 20
"""
_CONFIG = """
sensor = "kinect-v2-paper"
seed = 7
split = [0.7, 0.12, 0.18]
[[source]]
kind = "procedural"
subjects = 10
weight = 2
[pose]
yaw_deg = { uniform = [-30, 30] }
distance_mm = { normal = [900, 50] }
[scene]
wall_mm = 1500
[stage.axial]
base_sigma_mm = 2.0
[output]
crop = 128
layers = ["clean", "noisy"]
depth_unit_mm = 0.5
"""
_RECIPE = """
extends = "paper"
title = "mine"
[model]
kind = "mask_aware"
uncertainty = true
backbone = { kind = "small_unet", width = 8, scales = 3, blocks = 2, growth = 0.5 }
[loss]
kind = "masked"
depth = "gaussian"
[optimiser]
lr = 1e-3
[training]
batch = 4
max_steps = 10
[data]
crop = 64
flip = true
"""
_GLSL = """#version 330 core
// mine: adds some noise
#include "reason.glsl"
uniform sampler2D u_depth;
uniform float sigma_mm = 1.5; //@ [0, 20] mm standard deviation
uniform int steps = 3; //@ [1, 8] 1 how many
uniform bool on = true; //@ 1 whether
uniform uvec2 u_seed;
out float depth; //@ 1/3 of the frame
void main() { depth = texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r + sigma_mm; }
"""


def _text(folder: Path, name: str, content: str, read: Callable[[Path], object]) -> Kind:
    path = folder / name
    path.write_text(content)

    def change(rng: np.random.Generator) -> None:
        data = content.encode()
        path.write_bytes(
            change_words(content, rng) if rng.random() < 0.7 else mutations.mutate(data, rng)
        )

    def whole() -> None:
        read(path)

    return Kind(change, whole)


def _sensor(path: Path) -> None:
    from glsim.sensors.sensor import load_sensor

    load_sensor(str(path)).describe()


def _config(path: Path) -> None:
    from glsim.settings.schema import load_settings

    load_settings(path)


def _recipe(path: Path) -> None:
    from glsim.train.losses.registry import build_loss
    from glsim.train.models.registry import weight_shapes
    from glsim.train.recipe import load_recipe

    recipe = load_recipe(str(path))
    build_loss(recipe.loss)
    weight_shapes(recipe.model)


def _glsl(path: Path) -> None:
    from glsim.noise.registry import find_stage

    find_stage(str(path))


#: Name -> a function that prepares the kind in a folder.
TEXT_KINDS: dict[str, Callable[[Path], Kind]] = {
    "sensor": partial(_text, name="mine.toml", content=_SENSOR, read=_sensor),
    "config": partial(_text, name="mine.toml", content=_CONFIG, read=_config),
    "recipe": partial(_text, name="mine.toml", content=_RECIPE, read=_recipe),
    "glsl": partial(_text, name="mine.glsl", content=_GLSL, read=_glsl),
}
