"""Loading a denoiser for one depth map, and deprecated names that still work."""

from __future__ import annotations

import json
import logging
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from glsim.denoise import compose, interface, load, load_denoiser
from glsim.errors import ConfigError
from tests.support import checkpoint_stand_in
from tests.support.eval_scenes import dome, noisy

CLEAN, NOISY = dome(), noisy(dome())


@pytest.fixture
def checkpoint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A checkpoint of a network with a soft validity of 0.75."""
    monkeypatch.setitem(sys.modules, "glsim.denoise.inference", checkpoint_stand_in)
    path = tmp_path / "best.pt"
    path.write_text(json.dumps({"gain": 0.2, "soft": True}))
    return path


@pytest.mark.parametrize("dtype", [np.float32, np.float64, np.uint16])
def test_a_denoiser_of_one_map_is_the_method_on_a_stack_of_one(dtype: type) -> None:
    for spec in ("masked_median", "temporal_median", "quadric:sigma_px=2"):
        depth_mm, valid = load_denoiser(spec)(NOISY.astype(dtype))
        expected = load(spec)(NOISY[None])
        np.testing.assert_array_equal(depth_mm, expected.depth_mm)
        np.testing.assert_array_equal(valid, expected.valid)
        assert depth_mm.shape == valid.shape == NOISY.shape
        assert valid.dtype == np.bool_


def test_a_soft_validity_is_a_mask_by_a_composite_or_a_probability(checkpoint: Path) -> None:
    noisy_mm: Any = NOISY.astype(np.uint16)
    raw = load_denoiser(str(checkpoint), composite=None)(noisy_mm)
    np.testing.assert_allclose(raw.valid, np.where(NOISY > 0, 0.75, 0.25))
    for composite, expected in compose(raw, noisy_mm).items():
        depth_mm, valid = load_denoiser(str(checkpoint), composite=composite)(noisy_mm)
        np.testing.assert_array_equal(depth_mm, expected)
        np.testing.assert_array_equal(valid, expected > 0)
    default = load_denoiser(str(checkpoint))(noisy_mm)
    np.testing.assert_array_equal(default.depth_mm, compose(raw, noisy_mm)["measured"])
    with pytest.raises(ConfigError, match="did you mean 'measured'"):
        load_denoiser(str(checkpoint), composite="mesured")


@pytest.mark.parametrize(
    ("depth", "words"),
    [
        (NOISY[None], r"shape \(H, W\)"),
        (NOISY > 0, "float or integer"),
        (NOISY * 1j, "float or integer"),
        (np.full_like(NOISY, np.nan), "finite"),
        (-NOISY, "at least 0"),
    ],
)
def test_what_is_no_depth_map_is_refused(depth: np.ndarray, words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        load_denoiser("median")(depth)


def test_the_parameter_sure_is_an_alias_and_is_logged_once(
    checkpoint: Path, caplog: pytest.LogCaptureFixture
) -> None:
    interface._log_renamed.cache_clear()
    depth = NOISY[None]
    with caplog.at_level(logging.WARNING):
        for probability in ("0.6", "0.75", "0.9"):
            new = load(f"{checkpoint}:min_probability={probability}")
            assert not caplog.records or probability != "0.6"
            old = load(f"{checkpoint}:sure={probability}")
            assert new.version == old.version
            for ours, theirs in zip(new(depth), old(depth), strict=True):
                np.testing.assert_array_equal(ours, theirs)
    assert [record.getMessage() for record in caplog.records] == [
        "denoiser parameter sure= is deprecated: write min_probability="
    ]


def test_an_alias_keeps_its_range_and_excludes_the_new_name(checkpoint: Path) -> None:
    with pytest.raises(ConfigError, match=r"sure must lie in \[0, 0.999\]"):
        load(f"{checkpoint}:sure=2")
    with pytest.raises(ConfigError, match="min_probability is given twice"):
        load(f"{checkpoint}:sure=0.5,min_probability=0.5")


def test_the_former_function_of_networks_warns(tmp_path: Path) -> None:
    network = pytest.importorskip("glsim.denoise.inference")
    from glsim.errors import DenoiserError

    with (
        pytest.warns(DeprecationWarning, match="load_network"),
        pytest.raises(DenoiserError, match="no such checkpoint"),
    ):
        network.load_denoiser(tmp_path / "none.pt", sure=0.9)
