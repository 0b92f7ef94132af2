"""Frames of a tuning, as the command line makes them; and what the driver says of a line."""

import json
from pathlib import Path

import numpy as np
import pytest

from glsim.cli.tune_page.figures import frame_figures, tuned_figures
from glsim.cli.tune_page.preview import Preview, marked_lines, pack, shown_layers
from glsim.cli.tune_page.tuning import StageCode, Tuning
from glsim.core.errors import ConfigError, ShaderError
from glsim.faces.one_mesh import OneMesh
from glsim.settings.schema import Settings, load_settings, with_assignments
from glsim.settings.source_settings import parse_source
from glsim.simulation.pipeline import simulate
from tests.support.scenes import face_mesh, sensor_file

STAGES = 'use = "gaussian"\nsigma_mm = 4', 'use = "range_gate"\nnear_mm = 300'


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    loaded = load_settings(overrides={"sensor": sensor_file(tmp_path, *STAGES), "strict": True})
    single = parse_source({"subjects": 1, "frames_per_subject": 4})
    return loaded.model_copy(update={"source": (single,)})


@pytest.fixture(scope="module")
def source() -> OneMesh:
    return OneMesh(face_mesh(40))


def test_a_tuning_gives_the_frames_of_its_settings(settings: Settings, source: OneMesh) -> None:
    preview = Preview(settings, lambda _: [source])
    values = {"gaussian.sigma_mm": 9, "scene.wall_mm": 1500, "seed": 5}
    drawn = [preview.draw(Tuning(settings.sensor, values, frame=n)).frame for n in (0, 1, 5)]
    wanted = list(simulate(with_assignments(settings, values), sources=[source]))
    for frame, number in zip(drawn, (0, 1, 1), strict=True):
        other = wanted[number]
        for layer in ("clean", "noisy", "infrared", "reason"):
            assert np.array_equal(frame.image(layer), other.image(layer)), layer


def test_a_refused_tuning_leaves_the_preview(settings: Settings, source: OneMesh) -> None:
    preview = Preview(settings, lambda _: [source])
    good = Tuning(settings.sensor)
    before = preview.draw(good).frame.noisy
    with pytest.raises(ConfigError, match="outside"):
        preview.draw(good.with_value("gaussian.sigma_mm", -1))
    text = Path("shaders/noise/gaussian.glsl").read_text().replace("void main() {", "void main( {")
    with pytest.raises(ShaderError) as refused:
        preview.draw(good.with_code("gaussian", StageCode(text)))
    wrong = [n for n, line in enumerate(text.splitlines(), 1) if "main(" in line]
    assert list(marked_lines(str(refused.value), "gaussian.glsl")) == wrong
    assert np.array_equal(preview.draw(good).frame.noisy, before)


def test_figures_are_those_of_the_noise_that_was_added(settings: Settings, source: OneMesh) -> None:
    preview = Preview(settings, lambda _: [source])
    frame = preview.draw(Tuning(settings.sensor, {"scene.wall_mm": 1500})).frame
    figures = frame_figures(frame)
    assert figures["face_sigma_mm"] == pytest.approx(4, rel=0.15)
    assert all(sigma == pytest.approx(4, rel=0.4) for _, sigma, _ in figures["angle"])
    assert figures["autocorrelation"]["row"][0] == pytest.approx(1)
    assert abs(figures["autocorrelation"]["row"][1]) < 0.1
    both = (frame.clean > 0) & (frame.noisy > 0)
    assert sum(figures["histogram"]["counts"]) <= figures["measured_px"] == both.sum()
    lost = preview.draw(Tuning(settings.sensor, {"range_gate.near_mm": 900})).frame
    (row,) = frame_figures(lost)["reasons"]
    assert row[0] == "out_of_range"
    assert row[2] == ((lost.clean > 0) & (lost.noisy == 0)).sum()
    json.dumps(figures, allow_nan=False)


def test_figures_do_not_depend_on_the_step_of_the_files(
    settings: Settings, source: OneMesh
) -> None:
    """Before a wall: steps of 0.1 mm are no depths ten times as large, with rims everywhere."""
    found = {}
    for step_mm in (1.0, 0.1):
        stored = with_assignments(settings, {"output.depth_unit_mm": step_mm})
        preview = Preview(stored, lambda _: [source])
        frame = preview.draw(Tuning(settings.sensor, {"scene.wall_mm": 1500})).frame
        found[step_mm] = frame_figures(frame)["silhouettes"], tuned_figures(frame)["rows"]
    (rims, rows), (fine_rims, fine_rows) = found[1.0], found[0.1]
    assert rims["right"]["edges"] == pytest.approx(fine_rims["right"]["edges"], rel=0.1)
    for (name, _, value), (_, _, fine) in zip(rows, fine_rows, strict=True):
        known = [fine, value] != [None, None]
        assert not known or fine == pytest.approx(value, rel=0.1, abs=0.3), name


def test_a_packet_holds_the_layers_of_the_window(settings: Settings, source: OneMesh) -> None:
    preview = Preview(settings, lambda _: [source])
    frame = preview.draw(Tuning(settings.sensor)).frame
    packet = pack(frame, 7)
    size = int.from_bytes(packet[:4], "little")
    head = json.loads(packet[4 : 4 + size])
    assert size % 4 == 0
    assert head["number"] == 7
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
        preview = Preview(settings.model_copy(update={"source": (single,)}), lambda _: [source])
        tuning = Tuning(settings.sensor, {"scene.wall_mm": 1200, "pose.distance_mm": 500})
        drawn = preview.draw(tuning)
        found[name] = shown_layers(drawn.frame)
        assert drawn.sensor.rig.baseline_m > 0
        packet = pack(drawn.frame, 1)
        head = json.loads(packet[4 : 4 + int.from_bytes(packet[:4], "little")])
        assert head["layers"][-1] == ["disparity", "f4"]
        assert packet.endswith(found[name]["disparity"].tobytes())
        off = preview.draw(tuning.with_value("match_stereo.enabled", False))
        assert "disparity" not in shown_layers(off.frame)
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
