"""The page that denoises maps in the browser: against ``glsim denoise``, and what it asks for."""

from __future__ import annotations

import base64
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.cli import main
from glsim.denoise import MapDenoiser, load
from glsim.errors import ConfigError, DatasetError
from glsim.files.png import encode_png, read_depth_png, stated_unit_mm
from glsim.frame import encode_depth
from glsim.pipeline import frames
from glsim.settings.schema import load_settings
from glsim.tune.denoise_page import write_denoise_page
from glsim.tune.onnxruntime_web import fetch_runtime
from glsim.tune.static_page import write_static_page
from tests.support.local_site import served
from tests.support.static_page import open_page
from tests.tune.test_static_page import HEAD

_TAKE = """async ([files, network, step]) => {
  document.getElementById("network").value = network;
  document.getElementById("step").value = step;
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  await glsimDenoise.take(files.map(([name, text]) => new File([bytes(text)], name)));
}"""
_RESULT = """() => {
  const { result } = glsimDenoise.state;
  if (!result) return null;
  let text = "";
  const all = new Uint8Array(result.depth.buffer);
  for (let i = 0; i < all.length; i += 8192) {
    text += String.fromCharCode(...all.subarray(i, i + 8192));
  }
  return btoa(text);
}"""
#: What is said is neither "reading" nor "denoising" nor a problem. (The policy forbids to wait for
#: expressions.)
_DONE = "#message[class='']"
_READY = "#network option >> nth=0"

Files = dict[str, bytes]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the whole page; onnxruntime-web comes from the cache, else from npm."""
    try:
        fetch_runtime()
    except (ConfigError, DatasetError) as error:
        pytest.skip(f"needs onnxruntime-web: {error}")
    folder = tmp_path_factory.mktemp("site")
    write_static_page(folder, ["kinect-v2"], scenes=[HEAD], denoise=True)
    return folder


@pytest.fixture(scope="module")
def opened(site: Path) -> Iterator[tuple[Any, list[str], list[str]]]:
    """The page, its errors, and all addresses that it or its worker asks for."""
    with served(site) as (address, _), open_page("about:blank", "html") as (page, errors):
        asked: list[str] = []
        page.context.on("request", lambda request: asked.append(request.url))
        page.goto(f"{address}/denoise.html")
        page.wait_for_selector(_READY, state="attached")
        yield page, errors, asked


@pytest.fixture(scope="module")
def measured() -> list[Any]:
    """Simulate five frames of a head before a wall, 512 x 424 px."""
    settings = load_settings(
        overrides={
            "seed": 5,
            "sensor": "kinect-v2",
            "source": {"kind": "procedural", "subjects": 1, "frames_per_subject": 5},
            "pose": {"distance_mm": 850},
            "scene": {"wall_mm": 1700},
        }
    )
    return list(frames(settings))


def _denoised(page: Any, files: Files, network: str, step: float = 1) -> NDArray[np.float32]:
    """Give files to the page; return the depth that it makes of the first map, flat, mm."""
    given = [[name, base64.b64encode(data).decode()] for name, data in files.items()]
    page.evaluate(_TAKE, [given, network, step])
    text = page.evaluate(_RESULT)
    assert text is not None, page.inner_text("#message")
    return np.frombuffer(base64.b64decode(text), "<f4")


def _check_same(found: NDArray[np.float32], expected: NDArray[np.float32]) -> None:
    """Ask for 99.9 % of the pixels within 0.5 mm, none or depth alike, and for far less on most."""
    apart = np.abs(found - expected.ravel())
    assert (expected > 0).sum() > 1000
    assert (apart <= 0.5).mean() >= 0.999
    assert ((found > 0) == (expected.ravel() > 0)).mean() >= 0.9995
    assert np.percentile(apart, 99) < 0.02


def _npy(values: NDArray[Any]) -> bytes:
    file = io.BytesIO()
    np.save(file, values)
    return file.getvalue()


@pytest.mark.long
def test_a_whole_frame_is_that_of_glsim_denoise(
    opened: tuple[Any, list[str], list[str]], measured: list[Any], tmp_path: Path
) -> None:
    """The saved file, too: in steps of 0.1 mm, which it states, as the command writes it."""
    page, errors, _ = opened
    map_file = encode_png(measured[0].noisy, 1.0)
    (tmp_path / "noisy.png").write_bytes(map_file)
    assert main(["denoise", str(tmp_path / "noisy.png"), "-o", str(tmp_path / "out.png")]) == 0
    found = _denoised(page, {"noisy.png": map_file}, "face")
    wanted = read_depth_png(tmp_path / "out.png") * np.float32(0.1)
    assert not np.array_equal(found, measured[0].noisy.ravel())
    _check_same((np.rint(found * 10) / np.float32(10)).astype(np.float32), wanted)
    with page.expect_download() as waiting:
        page.click("#save")
    saved = tmp_path / waiting.value.suggested_filename
    waiting.value.save_as(saved)
    assert saved.name == "noisy_denoised.png"
    assert stated_unit_mm(saved) == 0.1
    units = encode_depth(found * np.float32(0.001), 0.1)
    np.testing.assert_array_equal(read_depth_png(saved).ravel(), units)
    assert errors == []


@pytest.mark.long
def test_each_network_gets_what_it_takes(
    opened: tuple[Any, list[str], list[str]], measured: list[Any]
) -> None:
    """Compare the page with Python on crops of 128 px: depth alone, then with earlier frames."""
    page, errors, _ = opened
    crop = np.s_[120:248, 190:318]
    names = page.evaluate("Object.keys(glsimFacts.networks)")
    assert "face" in names
    for name in names:
        method = load(name)
        frame = measured[0]
        files = {"frame_9_noisy.png": encode_png(frame.noisy[crop])}
        files["frame_9_infrared.png"] = encode_png(frame.infrared[crop])
        denoiser = MapDenoiser(method)
        _check_same(_denoised(page, files, name), denoiser(frame.noisy[crop]).depth_mm)
        if not method.temporal:
            continue
        stream = denoiser.stream()
        for number, each in enumerate(measured):
            expected = stream.push(each.noisy[crop]).depth_mm
            files[f"frame_{number + 9}_noisy.png"] = encode_png(each.noisy[crop])
        _denoised(page, files, name)
        for _ in measured[1:]:
            page.click("#later")
        page.wait_for_selector(_DONE)
        found = np.frombuffer(base64.b64decode(page.evaluate(_RESULT)), "<f4")
        assert page.inner_text("#place") == "5 of 5"
        _check_same(found, expected)
    assert errors == []


@pytest.mark.long
@pytest.mark.parametrize(
    ("sensor", "network"),
    [("realsense-d435", "face-stereo"), ("azure-kinect", "face-azure-kinect")],
)
def test_rims_before_nothing_are_those_of_python(
    opened: tuple[Any, list[str], list[str]], sensor: str, network: str
) -> None:
    """Compare the pixels that the page and Python drop at the silhouette of a head."""
    page, errors, _ = opened
    source = {"subjects": 1, "frames_per_subject": 1}
    overrides = {"sensor": sensor, "pose": {"distance_mm": 900}, "output": {"crop": 192}}
    (frame,) = frames(load_settings(overrides=overrides, source=source))
    expected = MapDenoiser(load(network))(frame.noisy).depth_mm
    assert ((frame.noisy > 0) & (expected == 0)).sum() > 100
    _check_same(_denoised(page, {"a.png": encode_png(frame.noisy)}, network), expected)
    assert errors == []


@pytest.mark.long
def test_formats_and_steps(opened: tuple[Any, list[str], list[str]], measured: list[Any]) -> None:
    page, _, _ = opened
    crop = measured[1].noisy[120:248, 190:318]
    expected = _denoised(page, {"a.png": encode_png(crop)}, "face")
    metres = crop.astype(np.float32) / np.float32(1000)
    for files in (
        {"a.npy": _npy(crop)},
        {"a.npy": _npy(metres)},
        {"a.npy": _npy(np.where(metres > 0, metres, np.nan).astype(">f8"))},
        {"a.png": encode_png(crop * np.uint16(10), 0.1)},
    ):
        found = _denoised(page, files, "face")
        np.testing.assert_allclose(found, expected, atol=0.01)
    found = _denoised(page, {"a.png": encode_png(crop * np.uint16(5))}, "face", 0.2)
    np.testing.assert_allclose(found, expected, atol=0.01)


@pytest.mark.long
def test_maps_without_noise_stay_as_they_are(
    opened: tuple[Any, list[str], list[str]], measured: list[Any]
) -> None:
    page, _, _ = opened
    clean = measured[0].clean
    found = _denoised(page, {"clean.png": encode_png(clean)}, "face")
    np.testing.assert_array_equal(found, clean.ravel())
    assert "no noise" in page.inner_text("#message")
    smooth = clean[120:248, 190:318]  # the network of stereo denoises every map
    found = _denoised(page, {"clean.png": encode_png(smooth)}, "face-stereo")
    assert "no noise" not in page.inner_text("#message")
    _check_same(found, MapDenoiser(load("face-stereo"))(smooth).depth_mm)
    assert not _denoised(page, {"none.png": encode_png(np.zeros_like(clean))}, "face").any()
    # Noise of 0.3 mm dithers the steps: the size of noise alone would take it for rounding.
    white = np.random.default_rng(0).normal(0, 0.3, clean.shape)
    near = np.where(measured[0].clean_m > 0, 1000 * measured[0].clean_m + white, 0)
    dithered = np.rint(near).astype(np.uint16)[120:248, 190:318]
    found = _denoised(page, {"dithered.png": encode_png(dithered)}, "face")
    assert "no noise" not in page.inner_text("#message")
    _check_same(found, MapDenoiser(load("face"))(dithered).depth_mm)


@pytest.mark.long
def test_other_files_are_refused_by_name(opened: tuple[Any, list[str], list[str]]) -> None:
    page, errors, _ = opened
    whole = encode_png(np.full((64, 64), 900, np.uint16))
    for name, data, words in (
        ("picture.png", encode_png(np.zeros((8, 8), np.uint8)), "one channel of 16 bits"),
        ("cut.png", whole[:-30], "is cut off"),
        ("text.png", b"no picture", "is no PNG file"),
        ("mm.npy", _npy(np.full((8, 8), 900, np.float32)), "divide it by 1000"),
        ("cube.npy", _npy(np.zeros((8, 8, 3), np.uint16)), "needs (H, W)"),
        ("large.npy", _npy(np.zeros((1025, 1024), np.uint16)), "1024 x 1025 pixels"),
        ("a_ir.png", whole, "give the depth maps too"),
    ):
        given = [[name, base64.b64encode(data).decode()]]
        page.evaluate(_TAKE, [given, "face", 1])
        said = page.inner_text("#message")
        assert words in said
        assert page.get_attribute("#message", "class") == "problem"
        assert words.startswith("give") or said.startswith(f"{name}: ")
    assert errors == []


@pytest.mark.long
def test_nothing_leaves_the_machine(
    opened: tuple[Any, list[str], list[str]], measured: list[Any], tmp_path: Path
) -> None:
    """After a run, all that was asked for lies in the folder, and the policy lets nothing else."""
    page, errors, asked = opened
    _denoised(page, {"a.png": encode_png(measured[2].noisy[:256, 128:384])}, "face")
    origin = page.evaluate("location.origin")
    assert any(address.endswith(".wasm") for address in asked)
    assert any(address.endswith("face.onnx") for address in asked)
    own = (f"{origin}/", f"blob:{origin}/", "data:")
    assert [a for a in asked if not a.startswith(own)] == []
    assert errors == []
    with served(tmp_path) as (other, received):
        for attempt in (
            f"fetch('{other}/x', {{ method: 'POST', body: 'depth' }})",
            f"new Promise((done, bad) => {{ const image = new Image(); image.onload = done; "
            f"image.onerror = bad; image.src = '{other}/x.png'; }})",
            f"new Promise((_, bad) => {{ navigator.sendBeacon('{other}/x', 'depth'); "
            "setTimeout(bad, 500); })",
        ):
            assert page.evaluate(f"{attempt}.then(() => 'sent', () => 'refused')") == "refused"
        assert received == []
        page.context.request.get(f"{other}/seen")  # the server would have heard it
        assert received
    errors.clear()  # the browser has told of all three


@pytest.mark.long
def test_a_dropped_file_and_a_narrow_screen(
    opened: tuple[Any, list[str], list[str]], measured: list[Any], tmp_path: Path
) -> None:
    page, errors, _ = opened
    data = base64.b64encode(encode_png(measured[3].noisy[120:248, 190:318])).decode()
    page.evaluate(
        """(text) => {
          const carried = new DataTransfer(),
            bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
          carried.items.add(new File([bytes], "dropped.png"));
          window.dispatchEvent(new DragEvent("drop", { dataTransfer: carried, cancelable: true }));
        }""",
        data,
    )
    page.wait_for_selector(_DONE)
    assert page.inner_text("#message").startswith("dropped.png: ")
    assert page.is_hidden("#hint")
    whole = page.viewport_size
    page.set_viewport_size({"width": 390, "height": 844})
    for place in (".top", ".said", ".view"):
        box = page.locator(f".tune {place}").bounding_box()
        assert (box["x"], box["width"]) == (0, 390), place
    for tile in page.locator(".tile").all():
        assert tile.bounding_box()["width"] > 150
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    page.set_viewport_size(whole)
    page.click("text=tune the noise")
    page.wait_for_selector("body[data-frames]")
    page.click("#denoise")
    page.wait_for_selector(_READY, state="attached")
    assert errors == []


@pytest.mark.long
def test_a_page_from_the_disk_says_what_it_needs(
    opened: tuple[Any, list[str], list[str]], site: Path
) -> None:
    page = opened[0].context.browser.new_page()
    page.goto((site / "denoise.html").as_uri())
    page.wait_for_selector("#message.problem")
    assert "python3 -m http.server" in page.inner_text("#message")
    assert page.is_disabled("#open")
    page.close()


def test_without_the_runtime_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GLSIM_CACHE", str(tmp_path / "cache"))
    with pytest.raises(ConfigError, match="run glsim fetch onnxruntime-web"):
        write_static_page(tmp_path / "site", ["kinect-v2"], scenes=[HEAD], denoise=True)
    with pytest.raises(ConfigError, match="run glsim fetch onnxruntime-web"):
        write_denoise_page(tmp_path / "site")
    assert not (tmp_path / "site").exists()
