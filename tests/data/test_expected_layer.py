"""The layer expected in frames and data sets: written, read, verified, refused where it lacks."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glsim import simulate
from glsim.core.errors import ConfigError, DatasetError
from glsim.data.driver import generate
from glsim.data.reader import open_dataset
from glsim.data.verification import verify
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.frame import Frame

LAYERS = ["clean", "expected", "noisy"]


def small(**output: Any) -> Settings:
    tree: dict[str, Any] = {
        "sensor": "kinect-v2-fast",
        "split": [0.0, 0.0, 1.0],
        "source": {"subjects": 2, "frames_per_subject": 1},
        "output": {"crop": 48, "depth_unit_mm": 0.1, **output},
    }
    return load_settings(overrides=tree)


@pytest.mark.parametrize("format", ["png", "webdataset"])
def test_a_data_set_holds_it(tmp_path: Path, format: str) -> None:
    generate(small(layers=LAYERS, format=format), tmp_path / "d", workers=1)
    generate(small(format=format), tmp_path / "plain", workers=1)
    dataset, plain = open_dataset(tmp_path / "d"), open_dataset(tmp_path / "plain")
    assert set(dataset.layers) == set(LAYERS)
    assert "systematic" in dataset.header["units"]["expected"]
    assert "expected" not in plain.header["units"]
    assert verify(tmp_path / "d", deep=True) == []
    for pair, other in zip(dataset, plain, strict=True):
        for layer in ("clean_mm", "noisy_mm"):
            np.testing.assert_array_equal(pair[layer], other[layer])
        seen = pair.clean_mm > 0
        np.testing.assert_array_equal(pair.expected_mm > 0, seen)
        error_mm = np.abs(pair.expected_mm - pair.clean_mm)[seen]
        assert 0.05 < error_mm.mean() < 5
    with pytest.raises(DatasetError, match=r"output\.layers=clean,expected"):
        plain.require("expected")
    with pytest.raises(DatasetError, match="no layer 'expected': it has clean, noisy"):
        _ = plain.frames()[0].expected_mm


def test_unit_shift_and_mask_are_those_of_the_clean_depth() -> None:
    frames = simulate(
        small(nearest_to_mm=600.0, clean_mask="as-noisy"), layers=("clean", "expected", "noisy")
    )
    for frame in frames:
        assert frame.expected_m is not None
        np.testing.assert_array_equal(frame.expected > 0, frame.clean > 0)
        units = np.abs(frame.expected.astype(int) - frame.clean.astype(int))
        assert 0 < units.max() < 100  # of 0.1 mm
        np.testing.assert_array_equal(frame.image("expected"), frame.expected)


def test_a_frame_without_it_says_so() -> None:
    (frame, _) = simulate(small())
    assert frame.expected_m is None
    with pytest.raises(ConfigError, match="made without the layer 'expected'"):
        frame.image("expected")


STAGE = """#version 330 core
// bend: moves all depths by a share, and says so.
uniform float share = 0.01;  //@ [0, 1] 1 share of the depth
uniform sampler2D u_depth;
{guard}
uniform sampler2D u_expected;
out float expected;
{end}
out float depth;
void main() {{
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = texelFetch(u_depth, pixel, 0).r * (1.0 + share);
{guard}
    expected = texelFetch(u_expected, pixel, 0).r * (1.0 + share);
{end}
}}
"""


def frames_with_and_without(sensor: Path) -> tuple[Frame, Frame]:
    """Simulate a frame with and without the layer."""
    source = {"subjects": 1, "frames_per_subject": 1}
    settings = load_settings(overrides={"sensor": str(sensor), "source": source})
    (with_it,) = simulate(settings, layers=("clean", "expected", "noisy"))
    (without,) = simulate(settings, layers=("clean", "noisy"))
    assert isinstance(with_it, Frame)
    assert isinstance(without, Frame)
    return with_it, without


@pytest.mark.parametrize(("guard", "end"), [("#ifdef EXPECTED", "#endif"), ("", "")])
def test_a_stage_of_the_users_own_adds_to_it(tmp_path: Path, guard: str, end: str) -> None:
    """After the shipped stages, with and without the guard that saves time."""
    (tmp_path / "bend.glsl").write_text(STAGE.format(guard=guard, end=end))
    (tmp_path / "mine.toml").write_text(
        'title = "mine"\n[rig]\nwidth = 128\nheight = 128\nfocal_px = [365.0, 365.0]\n'
        "centre_px = [64.0, 64.0]\nmodulation_mhz = [80, 16, 120]\n"
        "[[rig.emitter]]\nposition_m = [0.049, 0, 0]\n"
        '[[stage]]\nuse = "tof_fast"\n[[stage]]\nuse = "bend.glsl"\n'
    )
    with_it, without = frames_with_and_without(tmp_path / "mine.toml")
    assert with_it.expected_m is not None
    assert without.noisy_m.tobytes() == with_it.noisy_m.tobytes()
    assert without.expected_m is None
    seen = with_it.clean_m > 0
    share = (with_it.expected_m / np.where(seen, with_it.clean_m, 1))[seen]
    assert np.abs(share - 1.01).max() < 0.01
    assert share.std() > 1e-5  # the wiggling of tof_fast is in it


BEND = """
import numpy as np
from glsim.noise.stage import array_stage

@array_stage(share=("float", 0.01, 0, 1, "1", "share of the depth"))
def bend(view, layers, p):
    factor = np.float32(1 + p["share"])
    written = {"depth": layers["depth"] * factor}
    if "expected" in layers:
        written["expected"] = layers["expected"] * factor
    return written

"""


def test_an_array_stage_of_the_users_own_adds_to_it(tmp_path: Path) -> None:
    (tmp_path / "bend.py").write_text(BEND)
    (tmp_path / "mine.toml").write_text(
        'title = "mine"\n[rig]\nwidth = 128\nheight = 128\nfocal_px = [365.0, 365.0]\n'
        'centre_px = [64.0, 64.0]\n[[stage]]\nuse = "bend.py:bend"\n'
    )
    with_it, without = frames_with_and_without(tmp_path / "mine.toml")
    assert without.expected_m is None
    np.testing.assert_allclose(with_it.expected_m, with_it.clean_m * 1.01, rtol=1e-6)
