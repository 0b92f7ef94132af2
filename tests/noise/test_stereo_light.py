"""Infrared images of imagers: shader and twin agree; dots, noise and exposure are as declared."""

from collections.abc import Mapping

import numpy as np
import pytest
from moderngl import Context

from glsim.core.rect import Rect
from glsim.noise.frame_context import FrameContext
from glsim.noise.twins.layers import pcg_word
from glsim.noise.twins.stereo import dots
from tests.support.stage_harness import (
    FOCAL_PX,
    Z_MAX,
    Image,
    crop,
    frame,
    layers_of,
    run_shader,
    run_twin,
    scene,
    values,
)

OPTICS = {
    "emitters_m": ((0.028, 0.0, 0.0), (0.035, 0.004, 0.0)),
    "imagers_m": ((0.0, 0.0, 0.0), (0.05, 0.0, 0.0)),
    "second_view_m": (0.05, 0.0, 0.0),
    "focal_px": FOCAL_PX,
    "subject_m": 0.8,
}

CASES: list[tuple[str, dict[str, float]]] = [
    ("stereo_light", {}),
    ("stereo_light", {"dot_disorder": 0, "dot_variation": 0, "flood": 1, "fall_off_power": 3}),
    ("stereo_light", {"gain_counts": 0, "texture_share": 0.5, "texture_mm": 12}),
    ("stereo_light", {"daylight": 1e-3, "texture_mm": 12}),
    ("pattern_light", {"dot_spacing_mrad": 5.3, "dot_sigma_mrad": 1.1}),
    ("stereo_exposure", {}),
    ("stereo_exposure", {"bits": 10, "longest_exposure": 0, "psf_sigma_px": 0, "exposure": 3}),
    ("pattern_exposure", {"speckle_sigma": 0.2, "read_sigma_counts": 4}),
]


def imager_frame(seed: int = 0, **changes: object) -> FrameContext:
    return frame(seed, **(OPTICS | changes))


def with_imagers(layers: Mapping[str, Image]) -> dict[str, Image]:
    """Return layers with those of two imagers; both see the same depth, shadows differ."""
    made = dict(layers)
    shape = layers["normal"].copy()
    shape[..., 3] = layers["albedo"]
    height, width = layers["clean"].shape
    column = np.broadcast_to(np.arange(width) % 40 < 30, (height, width)).astype(np.float32)
    for side, lit in (("left", np.ones_like(column)), ("right", column)):
        made |= {f"{side}_clean": layers["clean"], f"{side}_normal": shape}
        made[f"{side}_lit"] = np.stack([lit, 0.5 * column], axis=-1)
    seen = layers["clean"] > 0
    texture = np.random.default_rng(3).uniform(0, 300, (2, height, width)).astype(np.float32)
    made["light_left"], made["light_right"] = np.where(seen, texture, np.float32(0))
    return made


@pytest.mark.parametrize("window", [Rect(0, 0, 256, 212), Rect(31, 17, 150, 130)])
@pytest.mark.parametrize(("use", "p"), CASES)
def test_twin_agrees(context: Context, use: str, p: Mapping[str, float], window: Rect) -> None:
    at = imager_frame(window=window)
    layers = crop(with_imagers(scene()), at)
    shader, twin = run_shader(context, use, layers, at, **p), run_twin(use, layers, at, **p)
    assert set(shader) == set(twin)
    for name, image in shader.items():
        assert np.ptp(image) > 1
        if use.endswith("exposure"):  # whole counts: a rounding may fall to the other side
            off = np.abs(image - twin[name])
            assert off.max() <= 1
            assert (off > 0).mean() < 1e-3
        else:
            off = np.abs(image - twin[name]) > 1e-3 * np.maximum(1.0, np.abs(image))
            assert off.mean() <= 2e-4


@pytest.mark.parametrize("use", ["stereo_light", "pattern_light"])
def test_twin_throws_the_same_image(context: Context, use: str) -> None:
    """The image fills half of the view: its pixels, its edge, and no light outside."""
    at = imager_frame(projector_tan=(0.2, 0.12))
    image = np.random.default_rng(1).random((37, 61), np.float32)
    layers = with_imagers(scene()) | {"projector_image": image}
    p = {"ambient_counts": 0.0}
    shader, twin = run_shader(context, use, layers, at, **p), run_twin(use, layers, at, **p)
    drawn = run_twin(use, with_imagers(scene()), at, **p)
    for name, light in shader.items():
        off = np.abs(light - twin[name]) > 1e-3 * np.maximum(1.0, np.abs(light))
        assert off.mean() <= 2e-4  # a rounding at the image's edge
        assert light.max() > 0
        assert (light == 0).mean() > (drawn[name] == 0).mean() + 0.2, "dark around the image"
        assert not np.allclose(light, drawn[name], rtol=0.1)


@pytest.mark.long
def test_dots_have_the_declared_density_size_and_disorder() -> None:
    step = 0.25e-3
    y, x = np.mgrid[-0.4:0.4:step, -0.4:0.4:step].astype(np.float32)
    p = {k: np.float32(v) for k, v in values("stereo_light", {"dot_variation": 0.0}).items()}
    image = dots(np.stack([x, y], axis=-1), pcg_word(np.array([7], np.uint32)), p)
    spacing, sigma = 1e-3 * p["dot_spacing_mrad"], 1e-3 * p["dot_sigma_mrad"]
    count = (0.8 / spacing) ** 2
    assert image.sum() * step**2 == pytest.approx(count * 2 * np.pi * sigma**2, rel=0.03)
    inner = image[1:-1, 1:-1]
    peak = (inner > 0.9) & np.all(
        [inner >= image[1 + a : image.shape[0] - 1 + a, 1 + b : image.shape[1] - 1 + b]
         for a in (-1, 0, 1) for b in (-1, 0, 1)], axis=0,
    )  # fmt: skip
    assert peak.sum() == pytest.approx(count, rel=0.05)
    # Places within the cells are even over the share that disorder gives them.
    rows, columns = np.nonzero(peak)
    place = np.stack([x[1:-1, 1:-1][rows, columns], y[1:-1, 1:-1][rows, columns]]) / spacing
    inside = np.mod(place, 1)
    assert ((inside > 0.03) & (inside < 0.97)).mean() > 0.99  # but for dots that merge
    assert inside.std() == pytest.approx(0.9 / np.sqrt(12), rel=0.03)


def test_dots_move_by_the_disparity_between_the_imagers() -> None:
    """A wall's dots lie f B / z apart in the two images."""
    depth = np.full((212, 256), 0.5, np.float32)
    layers = with_imagers(layers_of(depth, np.array([0.0, 0.0, -1.0, 0.6])))
    for side in ("left", "right"):
        layers[f"{side}_lit"] = np.broadcast_to(np.array([1, 0], np.float32), (212, 256, 2))
    light = run_twin("stereo_light", layers, imager_frame(), ambient_counts=0.0, flood=0.0)
    moved = FOCAL_PX * 0.05 / 0.5
    left, right = light["light_left"], light["light_right"]
    correlation = [
        np.corrcoef(left[:, 60:].ravel(), right[:, 60 - d : 256 - d].ravel())[0, 1]
        for d in range(30, 44)
    ]
    assert 30 + int(np.argmax(correlation)) == round(moved)
    assert max(correlation) > 0.8


def test_noise_has_the_declared_variance(context: Context) -> None:
    light = np.full((212, 256), 100, np.float32)
    layers = with_imagers(scene()) | {"light_left": light, "light_right": light}
    p = {"pixel_gain_sigma": 0.0, "psf_sigma_px": 0.0, "longest_exposure": 0.0, "bits": 10}
    inner = (slice(2, -2), slice(2, -2))
    for run in (lambda *a, **k: run_shader(context, *a, **k), run_twin):
        found = run("stereo_exposure", layers, imager_frame(), **p)
        for image in found.values():
            wanted = 0.05 * 100 + 0.7**2 + (0.05 * 100) ** 2 + 1 / 12
            n = image[inner].size
            assert abs(image[inner].var() / wanted - 1) < Z_MAX * np.sqrt(2 / n)
            assert abs(image[inner].mean() - 100) < Z_MAX * np.sqrt(wanted / n)
        one, other = (image[inner].ravel() for image in found.values())
        assert abs(np.corrcoef(one, other)[0, 1]) < Z_MAX / np.sqrt(one.size)
