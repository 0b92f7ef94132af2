"""Frames of a tuning, as the command line makes them; and what the driver says of a line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from glsim.errors import ConfigError, ShaderError
from glsim.faces.one_mesh import OneMesh
from glsim.frame import Frame
from glsim.pipeline import simulate
from glsim.settings.schema import Settings, load_settings, with_assignments
from glsim.settings.source_settings import parse_source
from glsim.tune.bench import Bench, marked_lines
from glsim.tune.packet import pack, shown_layers
from glsim.tune.state import StageCode, Tuning
from glsim.tune.statistics import frame_statistics, silhouette_widths
from tests.support.scenes import face_mesh

SENSOR = """
title = "small"
[rig]
width = 96
height = 80
focal_px = [80, 80]
centre_px = [48, 40]
[[stage]]
use = "gaussian"
sigma_mm = 4
[[stage]]
use = "range_gate"
near_mm = 300
"""


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    file = tmp_path / "small.toml"
    file.write_text(SENSOR)
    loaded = load_settings(overrides={"sensor": str(file), "strict": True})
    single = parse_source({"subjects": 1, "frames_per_subject": 4})
    return loaded.model_copy(update={"source": (single,)})


@pytest.fixture(scope="module")
def source() -> OneMesh:
    return OneMesh(face_mesh(40))


def test_a_tuning_gives_the_frames_of_its_settings(settings: Settings, source: OneMesh) -> None:
    bench = Bench(settings, lambda _: [source])
    values = {"gaussian.sigma_mm": 9, "scene.wall_mm": 1500, "seed": 5}
    drawn = [bench.draw(Tuning(settings.sensor, values, frame=n)).frame for n in (0, 1, 5)]
    wanted = list(simulate(with_assignments(settings, values), sources=[source]))
    for frame, number in zip(drawn, (0, 1, 1), strict=True):
        other = wanted[number]
        assert isinstance(other, Frame)
        for layer in ("clean", "noisy", "infrared", "reason"):
            assert np.array_equal(frame.image(layer), other.image(layer)), layer
    bench.close()


def test_a_refused_tuning_leaves_the_bench(settings: Settings, source: OneMesh) -> None:
    bench = Bench(settings, lambda _: [source])
    good = Tuning(settings.sensor)
    before = bench.draw(good).frame.noisy
    with pytest.raises(ConfigError, match="outside"):
        bench.draw(good.with_value("gaussian.sigma_mm", -1))
    text = Path("shaders/noise/gaussian.glsl").read_text().replace("void main() {", "void main( {")
    with pytest.raises(ShaderError) as refused:
        bench.draw(good.with_code("gaussian", StageCode(text)))
    wrong = [n for n, line in enumerate(text.splitlines(), 1) if "main(" in line]
    assert list(marked_lines(str(refused.value), "gaussian.glsl")) == wrong
    assert np.array_equal(bench.draw(good).frame.noisy, before)
    bench.close()
    assert np.array_equal(bench.draw(good).frame.noisy, before), "it opens another context"
    bench.close()


def test_the_noise_of_a_frame_can_be_kept(settings: Settings, source: OneMesh) -> None:
    bench = Bench(settings, lambda _: [source])
    own = [bench.draw(Tuning(settings.sensor, frame=n)).frame.noisy for n in (0, 1)]
    kept = bench.draw(Tuning(settings.sensor, frame=1), noise_of=0).frame.noisy
    assert not np.array_equal(own[0], own[1])
    assert np.array_equal(kept, own[0]), "one mesh: the frames differ by their noise alone"
    bench.close()


def test_figures_are_those_of_the_noise_that_was_added(settings: Settings, source: OneMesh) -> None:
    bench = Bench(settings, lambda _: [source])
    drawn = bench.draw(Tuning(settings.sensor, {"scene.wall_mm": 1500}))
    figures = frame_statistics(drawn.frame, drawn.normal)
    assert figures["sigma_mm"] == pytest.approx(4, rel=0.05)
    assert figures["face_sigma_mm"] == pytest.approx(4, rel=0.15)
    assert all(sigma == pytest.approx(4, rel=0.4) for _, sigma, _ in figures["angle"])
    assert figures["autocorrelation"]["row"][0] == pytest.approx(1)
    assert abs(figures["autocorrelation"]["row"][1]) < 0.1
    both = (drawn.frame.clean > 0) & (drawn.frame.noisy > 0)
    assert sum(figures["histogram"]["counts"]) == figures["measured_px"] - figures["beyond_px"]
    assert figures["measured_px"] == both.sum()
    lost = bench.draw(Tuning(settings.sensor, {"range_gate.near_mm": 900}))
    reasons = frame_statistics(lost.frame, lost.normal)["reasons"]
    assert [row[0] for row in reasons] == ["out_of_range"]
    assert reasons[0][2] == ((lost.frame.clean > 0) & (lost.frame.noisy == 0)).sum()
    json.dumps([figures, silhouette_widths(drawn.frame)], allow_nan=False)
    bench.close()


def test_a_packet_holds_the_layers_of_the_window(settings: Settings, source: OneMesh) -> None:
    bench = Bench(settings, lambda _: [source])
    frame = bench.draw(Tuning(settings.sensor)).frame
    bench.close()
    packet = pack(frame, note="x")
    size = int.from_bytes(packet[:4], "little")
    head = json.loads(packet[4 : 4 + size])
    assert size % 4 == 0
    assert head["note"] == "x"
    assert head["window"] == list(frame.window)
    at = 4 + size
    shape = (frame.window.height, frame.window.width)
    assert [name for name, _ in head["layers"]] == ["clean", "noisy", "infrared", "reason"]
    for name, kind in head["layers"]:
        count = shape[0] * shape[1]
        layer = np.frombuffer(packet, f"<{kind}", count, at).reshape(shape)
        assert np.array_equal(layer, frame.image(name)[frame.window.slices])
        at += -(-layer.nbytes // 4) * 4
    assert at == len(packet)


def test_the_layers_follow_from_the_sensor(tmp_path: Path, source: OneMesh) -> None:
    """Two imagers: both images and what was matched; one imager: its image and the same."""
    one, both = "truedepth", "realsense-d435"
    rig = "width = 160\nheight = 120\nfocal_px = [110, 110]\ncentre_px = [80, 60]\n"
    for name in (one, both):
        text = f'extends = "{name}"\ntitle = "small"\n[rig]\n{rig}'
        (tmp_path / f"{name}.toml").write_text(text)
    found = {}
    for name in (one, both):
        settings = load_settings(overrides={"sensor": str(tmp_path / f"{name}.toml")})
        single = parse_source({"subjects": 1, "frames_per_subject": 1})
        bench = Bench(settings.model_copy(update={"source": (single,)}), lambda _: [source])
        tuning = Tuning(settings.sensor, {"scene.wall_mm": 1200, "pose.distance_mm": 500})
        drawn = bench.draw(tuning)
        found[name] = dict(shown_layers(drawn.frame))
        assert drawn.sensor.rig.baseline_m > 0
        packet = pack(drawn.frame)
        head = json.loads(packet[4 : 4 + int.from_bytes(packet[:4], "little")])
        assert head["layers"][-1] == ["disparity", "f4"]
        assert packet.endswith(found[name]["disparity"].tobytes())
        off = bench.draw(tuning.with_value("match_stereo.enabled", False))
        assert "disparity" not in dict(shown_layers(off.frame))
        bench.close()
    assert [*found[one]] == ["clean", "noisy", "infrared", "reason", "disparity"]
    assert [*found[both]][4:] == ["infrared_right", "disparity"]
    layers = found[both]
    measured = (layers["noisy"] > 0) & (layers["disparity"] > 0)
    assert measured.mean() > 0.5
    fb_px_mm = 110 * 50.17
    error_mm = fb_px_mm / layers["disparity"][measured] - layers["noisy"][measured]
    assert np.abs(error_mm).max() <= 0.501, "depth is the disparity's, rounded to 1 mm"
    assert (layers["infrared_right"] != layers["infrared"]).mean() > 0.5


def test_only_lines_of_the_file_itself_are_marked() -> None:
    message = (
        "noise/axial.glsl: noise/axial.glsl:7: error: `x' undeclared; lib/depth.glsl:3: error: y; "
        "noise/axial.glsl:7: error: again"
    )
    assert marked_lines(message, "axial.glsl") == {7: "error: `x' undeclared; error: again"}
    assert marked_lines("no place", "axial.glsl") == {}
