"""Supersampling: shaders get the rig's number of samples, whatever else their text says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import moderngl
import numpy as np
import pytest

from glsim.core.errors import ShaderError
from glsim.gl.includes import SHADER_ROOT
from glsim.render import renderer
from tests.support.scenes import V2_LENS, Plane, interior, layers_of, rectangle, rig

SHADERS = ("centres.frag", "lens_samples.frag")


@pytest.fixture
def shaders(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with copies of the shaders that know the number of samples."""
    (tmp_path / "render").mkdir()
    for name in SHADERS:
        text = (SHADER_ROOT / "render" / name).read_text()
        (tmp_path / "render" / name).write_text(text)
    monkeypatch.setattr(renderer, "SHADER_ROOT", tmp_path)
    return tmp_path / "render"


def reword(folder: Path, old: str, new: str) -> None:
    for name in SHADERS:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new))


@pytest.mark.parametrize("samples", [3, 5])
def test_a_reworded_shader_draws_the_same(
    context: moderngl.Context, shaders: Path, samples: int
) -> None:
    device = replace(rig(distortion=V2_LENS, deliver="raw"), supersample=samples)
    scene = [rectangle((-0.1, 0.12), (-0.1, 0.1), 0.9), rectangle((-3, 3), (-3, 3), 1.5)]
    plain = layers_of(context, device, scene)
    reword(shaders, "const int SIDE = SAMPLES_PER_AXIS;", "const int SIDE=(SAMPLES_PER_AXIS);")
    again = layers_of(context, device, scene)
    for name in ("clean", "normal", "uneven", "lit"):
        np.testing.assert_array_equal(plain[name], again[name], name)


def test_a_shader_with_a_number_of_its_own_is_refused(
    context: moderngl.Context, shaders: Path
) -> None:
    reword(shaders, "SAMPLES_PER_AXIS", "3")
    for name in SHADERS:
        with pytest.raises(ShaderError, match="SAMPLES_PER_AXIS is defined but not used"):
            renderer.supersampled_pass(context, replace(rig(), supersample=5), name)


def test_the_number_of_samples_reaches_the_shader(context: moderngl.Context) -> None:
    """The range of a slanted plane within a pixel is (n - 1) / n of its change per pixel."""
    three, five = (
        layers_of(context, replace(rig(), supersample=samples), [Plane(0.9, 30).mesh(0.1)])
        for samples in (3, 5)
    )
    inside = interior(three["clean"])
    ratio = np.median((five["uneven"] / np.maximum(three["uneven"], 1e-9))[inside])
    assert ratio == pytest.approx((4 / 5) / (2 / 3), rel=0.05)
