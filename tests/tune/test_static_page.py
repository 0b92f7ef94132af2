"""The page without a server: what it writes, and WebGL2 in Chromium against the engine."""

from __future__ import annotations

import base64
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.errors import ConfigError
from glsim.frame import Frame, encode_depth
from glsim.frame_assembly import reconcile_reasons
from glsim.gl.includes import SHADER_ROOT
from glsim.noise.registry import shipped_stages
from glsim.pipeline import Simulator, open_sources
from glsim.plan.tasks import make_tasks
from glsim.sensors.sensor import Sensor, load_sensor
from glsim.settings.schema import load_settings
from glsim.tune.page_script import join_script
from glsim.tune.static_captures import CAPTURED_LAYERS, frame_context, whole_numbers
from glsim.tune.static_chains import describe_source
from glsim.tune.static_page import MODULES, page_sensors, write_static_page
from glsim.tune.static_scenes import Scene, capture, default_scenes
from tests.support.static_page import check_one_column, engine_layers, layers_of, open_page

#: A head without hair before nothing: quick to make, with silhouettes, shadows and grazing angles.
BARE = {
    "source": {"kind": "procedural", "subjects": 1, "frames_per_subject": 1},
    "pose": {"motion": 0},
}
HEAD = Scene("bare", "a bare head", BARE, {"pose.yaw_deg": 20})
SEED = 7

_OPEN = """([sensor, seed]) => {
  Object.assign(glsimStatic.state, { sensor, seed, camera: 0, values: {}, code: {} });
  glsimStatic.open();
}"""
_RUN = """async () => {
  const run = await glsimStatic.run();
  const text = (bytes) => { // lists of numbers take Playwright minutes
    let all = "";
    for (let i = 0; i < bytes.length; i += 8192) {
      all += String.fromCharCode(...bytes.subarray(i, i + 8192));
    }
    return btoa(all);
  };
  const packed = (layers) => Object.fromEntries(Object.entries(layers).filter(([, v]) => v)
    .map(([name, v]) => [name, [v.constructor.name,
      text(new Uint8Array(v.buffer, v.byteOffset, v.byteLength))]]));
  const { layers, picture, inputs } = run;
  return { layers: packed(layers), picture: packed(picture.layers), inputs: packed(inputs) };
}"""
_TYPES = {"Float32Array": "<f4", "Uint16Array": "<u2", "Uint8Array": "u1"}


def _run(page: Any, sensor: str, seed: int) -> dict[str, dict[str, NDArray[Any]]]:
    """Run a sensor in the page; return its layers, its picture and its inputs, flat."""
    page.evaluate(_OPEN, [sensor, seed])
    got = page.evaluate(_RUN)
    return {
        part: {
            name: np.frombuffer(base64.b64decode(text), _TYPES[kind])
            for name, (kind, text) in layers.items()
        }
        for part, layers in got.items()
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("static")
    write_static_page(made, scenes=[HEAD])
    return made


@pytest.fixture(scope="module")
def opened(folder: Path) -> Iterator[tuple[Any, list[str]]]:
    with open_page(folder / "index.html") as (page, errors):
        yield page, errors


def test_the_script_holds_all_modules_and_asks_no_other_server(folder: Path) -> None:
    script = (folder / "tune.js").read_text()
    assert not re.search(r"^\s*(import|export) ", script, re.MULTILINE)
    for file in sorted(folder.rglob("*.*")):
        found = set(re.findall(r"https?://[\w.]+", file.read_text()))
        assert found <= {"http://www.w3.org"}, file
    assert "\\u003c" in join_script({"text": "</script>"}, MODULES)


def test_ten_heads_and_two_scenes_are_shipped() -> None:
    scenes = default_scenes()
    assert len({scene.name for scene in scenes}) == len(scenes) == 12
    assert sum("scene.wall_mm" in s.values or "preset" in s.base or "scene" in s.base
               for s in scenes) == 2  # fmt: skip


def test_a_finer_layer_is_cut_on_its_own_grid(context: moderngl.Context) -> None:
    """A crop of samples holds the samples of the cropped pixels."""
    settings = load_settings(overrides={**BARE, "sensor": "kinect-v2"})
    sources = open_sources(settings)
    whole = Simulator(settings, sources, context, CAPTURED_LAYERS)
    tasks = make_tasks(settings, sources)
    (full,) = whole.frames(tasks)
    (cut,) = whole.with_values({"output.crop": 64}).frames(tasks)
    assert isinstance(full, Frame)
    assert isinstance(cut, Frame)
    assert cut.extra["fine_seen"].shape == (3 * 64, 3 * 64, 2)
    np.testing.assert_array_equal(cut.extra["fine_seen"][1::3, 1::3, 0], cut.clean_m)


@pytest.mark.long
@pytest.mark.parametrize("name", page_sensors())
def test_webgl_gives_what_the_engine_gives(
    name: str, opened: tuple[Any, list[str]], context: moderngl.Context
) -> None:
    page, errors = opened
    sensor = load_sensor(name)
    settings = load_settings(overrides={**BARE, "sensor": name})
    sources = open_sources(settings)
    simulator = Simulator(settings, sources, context, CAPTURED_LAYERS)
    frame = capture(simulator, make_tasks(settings, sources)[0], HEAD)
    side = sensor.rig.supersample
    layers = layers_of(whole_numbers(frame, side), side)
    at = frame_context(frame, sensor, "bare", SEED)
    engine = engine_layers(context, sensor, layers, at)

    got = _run(page, name, SEED)
    for layer, image in got["inputs"].items():
        np.testing.assert_array_equal(image, layers[layer].ravel(), layer)
    depth = got["layers"]["depth"]
    expected = engine["depth"].ravel()
    np.testing.assert_array_equal(depth > 0, expected > 0)
    seen = expected > 0
    assert seen.sum() > 3000
    assert (depth[seen] == expected[seen]).mean() >= 0.98
    apart = np.abs(depth[seen] - expected[seen])
    assert (apart <= _tolerance_m(sensor, at.focal_baseline_px_m, expected[seen])).all()
    codes = reconcile_reasons(layers["clean"].ravel(), depth, got["layers"]["reason"])
    np.testing.assert_array_equal(got["picture"]["reason"], codes)
    np.testing.assert_array_equal(got["picture"]["noisy"], encode_depth(depth))
    assert errors == []


def _tolerance_m(
    sensor: Sensor, focal_baseline_px_m: float, depth_m: NDArray[np.float32]
) -> NDArray[np.float64]:
    """1 mm; for a sensor that rounds disparities, one of its steps more.

    Where the drivers differ in the last bit at the middle between two steps, they round apart.
    """
    tolerance = np.full(depth_m.shape, 0.00101)
    for stage in sensor.stages:
        if stage.name == "disparity_quantise":
            step_px = stage.settings["step_px"].bounds()[1]
            tolerance += step_px * depth_m.astype(np.float64) ** 2 / focal_baseline_px_m
    return tolerance


def test_sensors_that_match_images_have_no_page(tmp_path: Path) -> None:
    assert {"kinect-v2", "kinect-v1", "azure-kinect"} <= set(page_sensors())
    with pytest.raises(ConfigError, match=r"realsense-d435: .* leave --static out"):
        write_static_page(tmp_path, ["realsense-d435"])
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_the_page_reads_declarations_as_glsim_does(opened: tuple[Any, list[str]]) -> None:
    page, _ = opened
    for name in page_sensors():
        page.evaluate(_OPEN, [name, 0])
        for stage in page.evaluate("() => glsimStatic.chain().map(({linked, ...s}) => s)"):
            if not stage["array"]:
                declared = describe_source(SHADER_ROOT / stage["file"])
                assert {key: stage[key] for key in declared} == declared, stage["file"]
    assert len(shipped_stages()) > 20


def _chosen(page: Any, stage: str) -> None:
    page.evaluate(_OPEN, ["kinect-v2-fankhauser", 0])
    page.click(f".stage-row button.name >> text=/^{stage}$/")


def _depth(page: Any) -> list[float]:
    read = "async () => JSON.stringify(Array.from((await glsimStatic.run()).layers.depth))"
    return list(json.loads(page.evaluate(read)))


def test_a_slider_changes_the_image_and_the_address(opened: tuple[Any, list[str]]) -> None:
    page, _ = opened
    _chosen(page, "axial")
    before = _depth(page)
    page.fill("[data-parameter=base_sigma_mm] input[type=number]", "6")
    page.keyboard.press("Enter")
    after = _depth(page)
    assert np.std(np.subtract(after, before)[np.array(before) > 0]) > 0.002
    assert "axial.base_sigma_mm=6" in page.evaluate("location.hash")
    options = page.evaluate("glsimStatic.setLine()")
    assert options == "--sensor kinect-v2-fankhauser --set axial.base_sigma_mm=6"
    page.reload()
    page.wait_for_selector("body[data-frames]")
    assert _depth(page) == after


@pytest.mark.long
def test_a_mistake_is_marked_and_the_last_good_program_runs(opened: tuple[Any, list[str]]) -> None:
    page, errors = opened
    _chosen(page, "axial")
    before = _depth(page)
    text = page.input_value("#editor textarea")
    page.fill("#editor textarea", text.replace("depth = ", "depth = missing + "))
    page.wait_for_selector("#editor .wrong")
    line = next(n for n, t in enumerate(text.splitlines(), 1) if re.search(r"\bdepth = ", t))
    assert page.inner_text("#editor .wrong").strip() == str(line)
    assert "missing" in page.inner_text("#problems")
    assert _depth(page) == before
    new = "uniform float push_mm = 30.0; //@ [0, 100] mm moves everything\n"
    good = text.replace("uniform", new + "uniform", 1)
    page.fill("#editor textarea", re.sub(r"\bdepth = ", "depth = 0.001 * push_mm + ", good))
    page.wait_for_selector("[data-parameter=push_mm]")
    assert page.is_hidden("#problems")
    moved = np.subtract(_depth(page), before)[np.array(before) > 0]
    assert np.median(moved) == pytest.approx(0.03, abs=0.0015)
    assert errors == []


@pytest.mark.long
def test_a_switched_off_stage_and_another_camera(opened: tuple[Any, list[str]]) -> None:
    page, errors = opened
    _chosen(page, "axial")
    before = _depth(page)
    page.uncheck("input[aria-label='axial runs']")
    assert _depth(page) != before
    assert page.is_hidden("#camera")
    page.evaluate(_OPEN, ["any-depth-camera", 0])
    first = _depth(page)
    page.click("#camera")
    assert _depth(page) != first
    assert errors == []


@pytest.mark.long
def test_a_narrow_screen_shows_pictures_and_editor(opened: tuple[Any, list[str]]) -> None:
    """390 px, a phone's: they had no width."""
    check_one_column(opened[0])
