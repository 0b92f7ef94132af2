"""The page without a server in a headless Chromium, and the engine on the same captured layers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from fractions import Fraction
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.gl.context import make_current
from glsim.gl.declarations import Layer
from glsim.gl.targets import Readback, Target, TargetPool
from glsim.noise.chain import ShaderChain
from glsim.noise.frame_context import FrameContext
from glsim.noise.stage import draw_values
from glsim.render.renderer import Rendered
from glsim.render.silhouette import SilhouettePass
from glsim.sensors.sensor import Sensor
from glsim.tune.static_captures import ALBEDO, DEPTH_M, LIT, MIXED_ABOVE, NORMAL, UNEVEN_M
from glsim.tune.static_chains import camera_keys

CHROMIUM = Path("/usr/bin/chromium")
#: WebGL2 in software; the page is opened from the disk.
_OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]

Images = dict[str, NDArray[np.float32]]


@contextmanager
def open_page(
    page_at: Path | str, ready: str = "body[data-frames]", **options: Any
) -> Iterator[tuple[Any, list[str]]]:
    """Open a page of 1280x800 in Chromium; yield it and the list of its errors.

    Skips the test with the reason if there is no Chromium.

    Args:
        page_at: a file, or the address of a server's page.
        ready: selector of what the page has when it can be used.
        options: of the browser's context.
    """
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright")
    if not CHROMIUM.exists():
        pytest.skip(f"needs {CHROMIUM}: apt-get install chromium")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=str(CHROMIUM), args=_OPTIONS)
        try:
            page = browser.new_page(viewport={"width": 1280, "height": 800}, **options)
            page.set_default_timeout(180_000)  # a busy machine links shaders for a minute
            errors: list[str] = []
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.on("console", lambda m: errors.append(m.text) if m.type == "error" else None)
            page.goto(page_at if isinstance(page_at, str) else page_at.resolve().as_uri())
            page.wait_for_selector(ready, timeout=120_000)
            yield page, errors
        finally:
            browser.close()


def layers_of(numbers: Mapping[str, NDArray[Any]], side: int) -> Images:
    """Return the float32 layers that a capture's integers stand for, as the page unpacks them."""
    clean, shape = numbers["clean"][0], numbers["shape"]
    height, width = clean.shape
    albedo = shape[2].astype(np.float32) * np.float32(ALBEDO)
    x, y = ((shape[n].astype(np.float64) - NORMAL) / NORMAL for n in (0, 1))
    z = -np.sqrt(np.maximum(1 - x * x - y * y, 0))
    normal = np.stack([x, y, z, albedo], axis=-1).astype(np.float32)
    depth = clean.astype(np.float32) * np.float32(DEPTH_M)
    layers: Images = {
        "clean": depth,
        "normal": np.where(clean[..., None] > 0, normal, np.float32(0)),
        "albedo": albedo,
        "lit": numbers["lit"][0].astype(np.float32) * np.float32(LIT),
    }
    if side > 1:
        uneven = numbers["uneven"][0]
        layers["uneven"] = uneven.astype(np.float32) * np.float32(UNEVEN_M)
        mixed, middle = uneven > MIXED_ABOVE, side * side // 2
        fine = np.empty((side * side, height, width, 2), np.float32)
        fine[:] = np.stack([depth, albedo], axis=-1)
        others = np.delete(np.arange(side * side), middle)
        depths = clean[mixed] + numbers["samples"][:, 0]
        albedos = shape[2][mixed] + numbers["sample_albedo"][:, 0]
        for sample, d, a in zip(others, depths, albedos, strict=True):
            fine[sample][mixed] = np.stack(
                [
                    d.astype(np.float32) * np.float32(DEPTH_M),
                    a.astype(np.float32) * np.float32(ALBEDO),
                ],
                axis=-1,
            )
        grid = fine.reshape(side, side, height, width, 2).transpose(2, 0, 3, 1, 4)
        layers["fine_seen"] = np.ascontiguousarray(grid.reshape(side * height, side * width, 2))
    return layers


def engine_layers(
    context: moderngl.Context, sensor: Sensor, layers: Images, at: FrameContext
) -> Images:
    """Run a sensor's shaders on layers of the window of ``at``; return depth, reason, infrared.

    Settings that are distributions have the numbers of the page's first camera.
    """
    make_current(context)
    _, values = draw_values(sensor.stages, camera_keys(0))
    pool = TargetPool(context, at.width, at.height)

    def target(name: str, image: NDArray[np.float32]) -> Target:
        parts = image.shape[2] if image.ndim > 2 else 1
        kind = {1: "float", 2: "vec2", 4: "vec4"}[parts]
        lent = pool.take(Layer(name, kind, Fraction(image.shape[1], at.window.width)), at.window)
        lent.texture.write(np.ascontiguousarray(image).tobytes(), viewport=lent.drawn)
        return lent

    targets = {name: target(name, image) for name, image in layers.items()}
    rays = pool.upload(Layer("rays", "vec2"), sensor.rig.rays())
    readback = Readback(context)
    seen_by = targets.get("uneven", targets["clean"])
    with SilhouettePass(pool).draw(seen_by, at.window) as silhouette:
        nearest = at.optics.nearest_m
        rendered = Rendered(targets, at.window, nearest, (nearest, nearest), silhouette, rays, pool)
        ShaderChain(context, sensor.stages).run(rendered, at, values, readback)
        return {name: array.copy() for name, array in readback.arrays().items()}


def check_one_column(page: Any) -> None:
    """Assert that a page of 390 px, a phone's, shows all of its parts below each other."""
    whole = page.viewport_size
    page.set_viewport_size({"width": 390, "height": 844})
    try:
        for place in (".left", ".view", ".figures", ".code", ".top"):
            box = page.locator(f".tune {place}").bounding_box()
            assert (box["x"], box["width"]) == (0, 390), place
            assert box["height"] > 60, place
        for tile in page.locator(".tile").all():
            if tile.is_visible():  # others are of layers that the sensor has not
                assert tile.bounding_box()["width"] > 150
    finally:
        page.set_viewport_size(whole)
