"""The map of a device's fixed pattern: added by shader and twin, subtracted, refused if wrong."""

from __future__ import annotations

from pathlib import Path

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

import glsim
from glsim.bench.validate import VirtualCamera, scenes
from glsim.core.errors import ConfigError
from glsim.sensors.sensor import SENSOR_FOLDER, load_sensor
from glsim.settings.schema import load_settings
from glsim.simulation.corrupt import Corrupter

SHAPE = (424, 512)
HOLE = np.s_[150:260, 200:240]


def a_map() -> NDArray[np.float32]:
    """Errors of 1 mm with an unknown rectangle."""
    values = np.random.default_rng(1).normal(0, 1, SHAPE).astype(np.float32)
    values[HOLE] = np.nan
    return values


def sensor_file(folder: Path, values: NDArray[np.generic] | None, stage: str = "") -> str:
    """A kinect-v2-fast of one stage, with a map beside it: no noise but the pattern."""
    rig = (SENSOR_FOLDER / "kinect-v2-fast.toml").read_text().split("[[stage]]")[0]
    rig = rig.replace("[rig]", '[rig]\nfixed_pattern_map = "own.npy"', 1)
    stage = stage or 'use = "fixed_pattern"\nrow_alternation_mm = 0\nrow_sigma_mm = 0'
    file = folder / "own.toml"
    file.write_text(f"{rig}\n[[stage]]\n{stage}\n")
    if values is not None:
        np.save(folder / "own.npy", values)
    return str(file)


def test_the_map_is_the_pattern_of_every_frame_and_crop(
    context: moderngl.Context, tmp_path: Path
) -> None:
    values = a_map()
    camera = VirtualCamera(sensor_file(tmp_path, values), context)
    whole = camera.capture(scenes.wall(900), 2, None)
    error = whole.measured_mm - whole.truth_mm
    assert np.array_equal(error[0], error[1])
    known = np.isfinite(values)
    assert np.abs(error[0] - values)[known].max() < 1e-3  # float32 metres at 0.9 m: 6e-5 mm
    # Where the map knows nothing the pattern is drawn: pixels of 0.25 mm, columns of 0.2 mm.
    drawn = error[0][HOLE]
    assert 0.2 < drawn.std() < 0.5
    crop = camera.capture(scenes.wall(900), 1, 96, at_mm=(60, 40, 900))
    image = camera.rig.intrinsics
    left = round(float(crop[0].rays[0, 0, 0]) * image.fx + image.cx - 0.5)
    top = round(float(crop[0].rays[0, 0, 1]) * image.fy + image.cy - 0.5)
    assert (left, top) != (0, 0)
    part = np.s_[top : top + 96, left : left + 96]
    assert np.array_equal(crop.measured_mm[0], whole.measured_mm[0][part])
    # Another device has the same map, and another drawn pattern.
    other = camera.capture(scenes.wall(900), 1, None, seed=5)
    again = other.measured_mm[0] - other.truth_mm
    assert np.array_equal(again[known], error[0][known])
    assert not np.array_equal(again[HOLE], drawn)


def test_shader_and_twin_add_the_same_map(context: moderngl.Context, tmp_path: Path) -> None:
    file = sensor_file(tmp_path, a_map())
    settings = load_settings(overrides={"sensor": file, "output": {"depth_unit_mm": 0.1}})
    flat = np.full(SHAPE, 9000, np.uint16)
    noisy = []
    for backend in (None, "numpy"):
        with Corrupter(settings, SHAPE, backend) as corrupter:
            noisy.append(1000.0 * corrupter.corrupt(flat, "wall").noisy_m)
    assert np.abs(noisy[0] - noisy[1]).max() < 1e-3
    with pytest.raises(ConfigError, match=r"own.npy: the map of the fixed pattern is 512x424, the"):
        Corrupter(settings, (100, 100), "numpy")


def test_the_header_of_a_data_set_names_the_map_by_its_values(tmp_path: Path) -> None:
    values = a_map()
    file = sensor_file(tmp_path, values)
    first = load_sensor(file).describe()["fixed_pattern_map"]
    values[0, 0] += 1
    np.save(tmp_path / "own.npy", values)
    assert load_sensor(file).describe()["fixed_pattern_map"] != first
    assert "fixed_pattern_map" not in load_sensor("kinect-v2").describe()


def test_maps_that_cannot_serve(tmp_path: Path) -> None:
    def refused(match: str, values: NDArray[np.generic] | None, stage: str = "") -> None:
        (tmp_path / "own.npy").unlink(missing_ok=True)
        file = sensor_file(tmp_path, values, stage)
        with pytest.raises(ConfigError, match=match) as caught:
            load_sensor(file)
        assert "\n" not in str(caught.value)

    refused(r"own.npy: no such file: rig.fixed_pattern_map names", None)
    refused("the map of the fixed pattern is 424x512, the image 512x424", a_map().T)
    refused("knows no pixel", np.full(SHAPE, np.nan, np.float32))
    refused("has infinite values", np.full(SHAPE, np.inf, np.float32))
    refused("errors of up to 900 mm, the limit is 20: give mm", np.full(SHAPE, 900.0))
    refused("must be one array of floats", np.zeros(SHAPE, np.uint8))
    refused("no stage reads it: add the stage 'fixed_pattern'", a_map(), 'use = "gaussian"')
    (tmp_path / "own.npy").write_bytes(b"no array")
    with pytest.raises(ConfigError, match=r"own.npy: cannot be read: is no whole .npy file"):
        load_sensor(sensor_file(tmp_path, None))


def test_remove_fixed_pattern_undoes_it() -> None:
    values = a_map()
    true = np.full(SHAPE, 900.0)
    measured = true + np.nan_to_num(values)
    measured[:3] = 0
    measured[3:6] = np.nan
    clean = glsim.remove_fixed_pattern(np.stack([measured, measured]), values)
    assert (clean.dtype, clean.shape) == (np.float32, (2, *SHAPE))
    assert np.abs(clean[:, 6:] - 900.0).max() < 1e-3
    assert (clean[:, :3] == 0).all()
    assert np.isnan(clean[:, 3:6]).all()
    whole = glsim.remove_fixed_pattern(np.full(SHAPE, 900, np.uint16), values)
    known = np.isfinite(values)
    assert np.allclose(whole[known], 900 - values[known])
    assert (whole[~known] == 900).all()
    with pytest.raises(ConfigError, match="is 512x424, the image 96x96"):
        glsim.remove_fixed_pattern(np.zeros((96, 96)), values)
