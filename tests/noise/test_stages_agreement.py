"""Properties of every stage: twin and shader agree, neutral settings, windows, reasons."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from moderngl import Context

from glsim.core.reason import Reason
from glsim.core.rect import Rect
from glsim.noise.registry import shipped_stages
from glsim.noise.twins import find_twin, takes_tensors
from glsim.noise.twins.edges import cells
from glsim.sensors.sensor import load_sensor
from tests.support.imports import ROOT
from tests.support.scenes import face_mesh, frames_of, settings_for
from tests.support.stage_harness import (
    FRAME,
    Image,
    crop,
    frame,
    run_on_tensors,
    run_shader,
    run_twin,
    scene,
)

#: Stages of time of flight and of imagers have layers of their own: test_tof_frames and
#: test_stereo_light.
SHADERS = [name for name, spec in shipped_stages().items() if spec.source is not None]
STAGES = [use for use in SHADERS if not use.startswith(("tof_", "stereo_", "pattern_"))]

#: Every stage with its defaults, and settings that reach other branches.
CASES: list[tuple[str, dict[str, float]]] = [
    *((use, {}) for use in STAGES),
    ("any_camera_edges", {"growth_px": 2.5, "rough_px": 1.0, "cut_px": 0.0, "max_mixed": 1.0}),
    ("any_camera_edges", {"growth_px": -1.5, "edge_holes": 0.3, "wavelength_m": 1e4}),
    ("any_camera_edges", {"light_mix": 0, "psf_px": 1.0, "haze": 0.1, "shadow_kept": 0.5}),
    ("any_camera_noise", {"tail": 0.8, "outlier_share": 0.02, "light_power": 0.5}),
    ("any_camera_noise", {"length_x_px": 6.0, "white_share": 0.0, "wiggle_mm": 6, "tilt_x_mm": 3}),
    ("any_camera_noise", {"inverse_per_m": 0.01, "static_share": 0.5, "length_y_px": 10.0}),
    ("any_camera_losses", {"single_share": 0.1, "cluster_share": 0.1, "step_px": 0.125}),
    ("any_camera_losses", {"dark_signal": 0.3, "dark_spread": 1, "saturated_signal": 1}),
    ("axial", {"angle_from_deg": 60, "angle_power": -0.5, "quadratic_from_m": 0.4}),
    ("disparity_quantise", {"step_px": 0.3}),
    ("dot_spread", {"radius_px": 3.9, "edge_mm": 1.0}),
    ("dot_spread", {"radius_px": 0.5}),
    ("edge_dropout", {"radius_px": 3, "probability": 1.0}),
    ("gaussian", {"sigma_mm": 0.0, "sigma_px": 0.15}),
    ("infrared", {"ambient_counts": 30}),
    ("lateral", {"angle_px": 0.035, "sigma_px": 0.8}),
    ("lateral", {"sigma_px": 4}),
    ("max_filter", {"radius_px": 4}),
    ("millimetre_quantise", {"step_mm": 0.7}),
    ("perlin", {"octaves": 5, "amplitude_mm": 0.0, "amplitude_px": 0.4, "persistence": 0.7}),
    ("perlin", {"lattice_x_px": 7.3, "lattice_y_px": 3, "drift_hz": 2, "lacunarity": 1.7}),
    ("range_gate", {"near_mm": 800, "far_mm": 1300}),
    ("simplex", {"amplitude_px": 0.5, "lattice_px": 3, "drift_hz": 2}),
    ("single_view_match", {"growth_px": 6.0, "largest_px": 40, "support_px": 7, "shadow_px": 1}),
    ("single_view_noise", {"growth_across_px": -2, "rim_px": 5, "dark_albedo": 0.3}),
]

WINDOWS = [Rect(0, 0, 256, 212), Rect(31, 17, 150, 130), Rect(100, 50, 1, 1)]

PATTERN = (
    "pixel_sigma_mm", "column_sigma_mm", "row_sigma_mm", "row_alternation_mm", "row_profile_mm",
    "row_step_mm",
)  # fmt: skip
#: Settings at which a stage does nothing.
NEUTRAL: list[tuple[str, dict[str, float]]] = [
    ("axial", {"base_sigma_mm": 0, "linear_mm_per_m": 0, "quadratic_mm_per_m2": 0, "angle_mm": 0}),
    ("axial", {"max_sigma_mm": 0}),
    ("edge_dropout", {"probability": 0}),
    ("fixed_pattern", dict.fromkeys(PATTERN, 0.0)),
    ("gaussian", {"sigma_mm": 0, "sigma_px": 0}),
    ("lateral", {"sigma_px": 0, "angle_px": 0}),
    ("low_signal", {"min_counts": 0, "spread_counts": 0}),
    ("max_filter", {"radius_px": 0}),
    ("perlin", {"amplitude_mm": 0, "amplitude_px": 0}),
    ("range_gate", {"near_mm": 0, "far_mm": 65535}),
    ("shadow", {"min_lit": 0}),
    ("simplex", {"amplitude_mm": 0, "amplitude_px": 0}),
]

#: Reach of a stage, px: nearer to the border of a window the result depends on the window.
REACH = {
    "any_camera_edges": 6,
    "lateral": 9,
    "edge_dropout": 4,
    "max_filter": 4,
    "correlation_window": 12,
    "dot_spread": 6,
    "single_view_match": 45,  # what disparities differ by, and 3 px
    "single_view_noise": 6,
}


def test_every_shader_has_a_twin() -> None:
    assert all(find_twin(name) is not None for name in SHADERS)


@pytest.mark.parametrize("window", [*WINDOWS, None])
@pytest.mark.parametrize(("use", "p"), CASES)
def test_twin_agrees(
    context: Context, use: str, p: Mapping[str, float], window: Rect | None
) -> None:
    """The twin on a window in NumPy, or on a batch of whole frames in PyTorch."""
    if window is None and not takes_tensors(use):
        return
    at = frame(window=window or WINDOWS[0], time_s=0.3)
    layers, run = crop(scene(), at), run_twin if window else run_on_tensors
    shader, twin = run_shader(context, use, layers, at, **p), run(use, layers, at, **p)
    assert set(shader) == set(twin)
    for name, image in shader.items():
        assert twin[name].dtype == np.float32
        assert twin[name].shape == image.shape
        # 2e-6 is 2 um of depth; a few pixels differ more, where a comparison was close.
        off = np.abs(image - twin[name]) > 2e-6 * np.maximum(1.0, np.abs(image))
        assert off.mean() <= 2e-4


@pytest.mark.parametrize(("use", "p"), NEUTRAL)
def test_neutral_settings_change_nothing(
    context: Context, use: str, p: Mapping[str, float]
) -> None:
    layers = scene()
    both = run_shader(context, use, layers, FRAME, **p), run_twin(use, layers, FRAME, **p)
    for written in both:
        for name, image in written.items():
            np.testing.assert_array_equal(image, layers[name])


@pytest.mark.parametrize("use", STAGES)
def test_noise_does_not_depend_on_the_window(context: Context, use: str) -> None:
    windows = Rect(20, 10, 150, 131), Rect(64, 41, 180, 150)
    overlap = windows[0].intersection(windows[1])
    margin = REACH.get(use, 0)
    inner = Rect(
        overlap.left + margin, overlap.top + margin,
        overlap.width - 2 * margin, overlap.height - 2 * margin,
    )  # fmt: skip
    whole = scene()
    for run in (lambda *a: run_shader(context, *a), run_twin):
        parts = []
        for window in windows:
            at = frame(window=window)
            written = run(use, crop(whole, at), at)
            parts.append(
                {name: _part(name, image, window, inner) for name, image in written.items()}
            )
        for name, image in parts[0].items():
            assert image.size > 100
            rounding = 2e-6 * (run is run_twin)  # a product of matrices adds up by their size
            np.testing.assert_allclose(image, parts[1][name], rtol=0, atol=rounding)


def _part(name: str, image: Image, window: Rect, inner: Rect) -> Image:
    if name == "dot_match":
        window, inner = cells(window), cells(inner)
    left, top = inner.left - window.left, inner.top - window.top
    return image[top : top + inner.height, left : left + inner.width]


@pytest.mark.parametrize(("use", "p"), CASES)
def test_depth_and_reason_fit(use: str, p: Mapping[str, float]) -> None:
    """Depth disappears or appears only with a reason."""
    layers = scene(1)
    written = {**layers, **run_twin(use, layers, FRAME, **p)}
    before, after = layers["depth"] > 0, written["depth"] > 0
    with_depth = np.isin(written["reason"], [r for r in Reason if r.has_depth])
    np.testing.assert_array_equal(after, with_depth)
    if "reason" not in run_twin(use, layers, FRAME, **p):
        np.testing.assert_array_equal(after, before)
    assert not np.isin(written["reason"][before & ~after], layers["reason"][before]).any()


@pytest.mark.parametrize("crop", [None, 64])
def test_the_stage_of_the_howto_and_its_twin_agree(
    crop: int | None, context: Context, tmp_path: Path
) -> None:
    page = (ROOT / "docs/howto/noise_stage.md").read_text(encoding="utf-8")
    blocks = dict(reversed(re.findall(r"```(glsl|python)\n(.*?)```", page, re.DOTALL)))
    (tmp_path / "burst.glsl").write_text(blocks["glsl"])
    (tmp_path / "s.toml").write_text(
        'title = "burst"\n[rig]\nwidth = 96\nheight = 80\nfocal_px = [80, 80]\n'
        'centre_px = [48, 40]\n[[stage]]\nuse = "burst.glsl"\n'
    )
    defined: dict[str, Any] = {}
    exec(blocks["python"], defined)
    sensor = str(tmp_path / "s.toml")
    settings = settings_for(sensor, scene={"wall_mm": 1500}, output={"crop": crop})
    (frame,) = frames_of(context, settings, face_mesh(40))
    camera = load_sensor(sensor).rig.delivered
    np.testing.assert_allclose(frame.noisy_m, defined["burst"](frame, camera), atol=2e-6)
    off_mm = 1000 * (frame.noisy_m - frame.clean_m)
    rows = np.abs(off_mm).max(axis=1) > 0.01
    assert 0.02 < rows.mean() < 0.25
    assert 4.5 < off_mm[rows].std() < 5.5
