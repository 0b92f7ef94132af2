"""Shipped sensors: they load, their reasons fit the depth, their noise is as published."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import moderngl
import numpy as np
import pytest
from numpy.typing import NDArray

from glsim.errors import ConfigError
from glsim.frame import Frame
from glsim.geometry.mesh import Mesh
from glsim.reason import Reason
from glsim.sensors.sensor import SENSOR_FOLDER, load_sensor, sensor_code, sensor_names, sensor_of
from glsim.settings.distribution import constant
from glsim.settings.schema import Settings, load_settings
from tests.support.scenes import Plane, face_mesh, frames_of, sensor_file, settings_for
from tests.support.stage_harness import Z_MAX, z_mean, z_rate, z_sd

SENSORS = sensor_names()


def on_plane(
    context: moderngl.Context,
    sensor: str,
    z_m: float,
    *only: str,
    tilt_deg: float = 0.0,
    stage: dict[str, dict[str, Any]] | None = None,
) -> Frame:
    """A frame of a plane with all stages off but ``only``, in steps of 0.1 mm."""
    off = {s.name: {"enabled": False} for s in load_sensor(sensor).stages if s.name not in only}
    settings = settings_for(
        sensor,
        stage=off | (stage or {}),
        output={"crop": 200, "depth_unit_mm": 0.1},
    )
    mesh = Plane(z_m, tilt_deg).mesh((0.5 if tilt_deg == 0 else 0.2) * z_m)
    return frames_of(context, at_distance(settings, z_m), moved(mesh, z_m))[0]


def moved(mesh: Mesh, z_m: float) -> Mesh:
    """Move a mesh along z to the canonical frame of a face at ``z_m``."""
    return replace(mesh, vertices_mm=mesh.vertices_mm + np.array([0, 0, 1000 * z_m], np.float32))


def at_distance(settings: Settings, z_m: float) -> Settings:
    pose = settings.pose.model_copy(update={"distance_mm": constant(1000 * z_m)})
    return settings.model_copy(update={"pose": pose})


def error_mm(frame: Frame) -> NDArray[np.floating]:
    both = (frame.clean_m > 0) & (frame.noisy_m > 0)
    return 1000 * (frame.noisy_m[both].astype(float) - frame.clean_m[both])


def test_all_of_them_are_known() -> None:
    azure = [f"azure-kinect{mode}" for mode in ("", "-nfov-binned", "-wfov", "-wfov-unbinned")]
    v1 = [f"kinect-v1{model}" for model in ("", "-nguyen", "-pattern")]
    v2 = [f"kinect-v2{model}" for model in ("", "-fankhauser", "-fast", "-paper", "-sdk")]
    d4 = [f"realsense-d4{m}" for m in ("05", "15", "35", "35-high-accuracy", "35-vga", "55")]
    ours = ["any-depth-camera", *azure, "femto-bolt", "ideal", *v1, *v2, "led3d", "oak-d-pro", *d4]
    assert [*ours, "truedepth", "truedepth-filtered"] == SENSORS
    with pytest.raises(ConfigError, match=r"no such sensor 'kinect-v3' .did you mean 'kinect-v"):
        load_sensor("kinect-v3")
    with pytest.raises(ConfigError, match=r"absent\.toml: no such file"):
        load_sensor("absent.toml")


@pytest.mark.parametrize("name", SENSORS)
def test_a_face_is_seen_with_reasons_that_fit(context: moderngl.Context, name: str) -> None:
    distance_mm = {"realsense-d405": 300, "truedepth": 400, "truedepth-filtered": 400}.get(
        name, 900
    )
    settings = settings_for(name, pose={"distance_mm": distance_mm, "yaw_deg": 20}, devices=2)
    for frame in frames_of(context, settings, face_mesh(), 3):
        valid, has = frame.noisy > 0, frame.clean > 0
        # Without a projector this face's even skin has little to match.
        least = 0.2 if name == "realsense-d405" else 0.7
        assert least * has.sum() < (valid & has).sum()
        codes = frame.reason
        for code in Reason:
            assert (valid[codes == code] == code.has_depth).all(), code
        assert (codes[~valid & has] != Reason.NO_SURFACE).all()
        assert (codes[~has & valid] != Reason.VALID).all()
        typical = np.abs(frame.noisy[valid & has].astype(int) - frame.clean[valid & has])
        assert np.median(typical) < 12
        if not name.startswith("truedepth"):  # its infrared image is seen from elsewhere
            assert frame.infrared[has].min() > 0
        described = load_sensor(name).describe()
        assert described["name"] == name
        assert len(described["stages"]) == len(load_sensor(name).stages)


def test_ideal_is_the_clean_depth_rounded(context: moderngl.Context) -> None:
    (frame,) = frames_of(context, settings_for("ideal"), face_mesh())
    np.testing.assert_array_equal(frame.noisy, frame.clean)
    np.testing.assert_allclose(frame.noisy_m, frame.clean_m, atol=0.000501)
    assert (frame.reason[frame.clean > 0] == Reason.VALID).all()


@pytest.mark.parametrize("z_m", [0.9, 2.0, 4.0])
def test_kinect_v2_has_the_sigma_of_fankhauser(context: moderngl.Context, z_m: float) -> None:
    """Only the distance terms: the plane faces the camera."""
    error = error_mm(on_plane(context, "kinect-v2-fankhauser", z_m, "axial"))
    assert abs(z_mean(error)) < Z_MAX
    assert abs(z_sd(error, 1.5 - 0.5 * z_m + 0.3 * z_m**2)) < Z_MAX


@pytest.mark.parametrize("tilt_deg", [45, 70])
def test_kinect_v2_is_noisier_on_tilted_surfaces(
    context: moderngl.Context, tilt_deg: float
) -> None:
    frame = on_plane(context, "kinect-v2-fankhauser", 1.0, "axial", tilt_deg=tilt_deg)
    clean, angle = frame.clean_m, np.radians(tilt_deg)
    ratio = (angle / (np.pi / 2 - angle)) ** 2
    seen = clean > 0
    z = clean[seen].astype(float)
    sigma = np.minimum(1.5 - 0.5 * z + 0.3 * z**2 + 0.1 * z**1.5 * ratio, 20.0)
    scaled = 1000 * (frame.noisy_m[seen].astype(float) - z) / sigma
    assert abs(z_mean(scaled)) < Z_MAX
    assert abs(z_sd(scaled, 1.0)) < Z_MAX


@pytest.mark.parametrize("z_m", [0.8, 2.0])
def test_kinect_v1_has_the_sigma_of_nguyen(context: moderngl.Context, z_m: float) -> None:
    error = error_mm(on_plane(context, "kinect-v1", z_m, "axial"))
    assert abs(z_sd(error, 1.2 + 1.9 * (z_m - 0.4) ** 2)) < Z_MAX


@pytest.mark.parametrize(("sensor", "focal_px"), [("kinect-v1", 580), ("kinect-v2-paper", 365.456)])
def test_structured_light_is_banded_in_eighths_of_a_pixel(
    context: moderngl.Context, sensor: str, focal_px: float
) -> None:
    frame = on_plane(context, sensor, 1.5, "disparity_quantise", tilt_deg=30)
    seen = frame.noisy_m > 0
    eighths = 8 * focal_px * 0.075 / frame.noisy_m[seen].astype(float)
    np.testing.assert_allclose(eighths, np.rint(eighths), atol=2e-3)
    assert len(np.unique(np.rint(eighths))) > 20
    shift_px = focal_px * 0.075 * (1 / frame.noisy_m[seen] - 1 / frame.clean_m[seen])
    assert np.abs(shift_px).max() < 1 / 16 + 1e-3


def test_the_fixed_pattern_of_the_kinect_v2(context: moderngl.Context) -> None:
    """Rows 0.59 to 0.72 mm, columns 0.05 to 0.29, the rest 0.17 to 0.29: four real devices."""
    frame = on_plane(context, "kinect-v2-fankhauser", 1.0, "fixed_pattern")
    error = 1000 * (frame.noisy_m.astype(float) - frame.clean_m)
    assert error.shape == (200, 200)
    rows, columns = error.mean(axis=1), error.mean(axis=0)
    rest = error - rows[:, None] - columns + error.mean()
    assert rows.std() == pytest.approx(np.hypot(0.69, 0.25), rel=0.1)
    assert abs(z_sd(columns, float(np.hypot(0.1, 0.22 * 3 / np.sqrt(200))))) < Z_MAX
    assert rest.std() == pytest.approx(0.22, rel=0.06)


@pytest.mark.parametrize(
    "sensor", ["kinect-v1", "kinect-v2", "kinect-v2-fankhauser", "kinect-v2-fast"]
)
def test_shadows_need_an_emitter(sensor: str) -> None:
    with pytest.raises(ConfigError, match=r"but the rig has no emitter") as caught:
        load_sensor(sensor, rig_overrides={"emitter": []})
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("focal_px", [float("inf"), 365.0]),
        ("focal_px", [1e30, 365.0]),
        ("focal_px", [0.0, 365.0]),
        ("focal_px", [1e-30, 365.0]),
        ("centre_px", [float("nan"), 205.0]),
        ("centre_px", [1e30, 205.0]),
        ("far_m", float("inf")),
        ("emitter", [{"position_m": [float("nan"), 0.0, 0.0]}]),
        ("emitter", [{"position_m": [1e30, 0.0, 0.0]}]),
        ("distortion", {"k1": float("nan")}),
    ],
)
def test_numbers_of_a_rig_are_those_of_a_camera(key: str, value: object) -> None:
    """Not refused here, they end a run as frames without a face, or as damaged records."""
    with pytest.raises(ConfigError, match=key) as caught:
        load_sensor("kinect-v2", rig_overrides={key: value})
    assert "\n" not in str(caught.value)


def test_a_file_says_only_what_differs_from_the_one_it_extends(tmp_path: Path) -> None:
    other = tmp_path / "mine.toml"
    other.write_text(
        'extends = "femto-bolt"\ntitle = "mine"\n[rig]\nwidth = 600\n'
        '[[stage]]\nuse = "tof_taps"\nhalo = 0.05\n'
    )
    mine, base = load_sensor(str(other)), load_sensor("azure-kinect")
    assert (mine.title, mine.rig.intrinsics.width, mine.rig.intrinsics.height) == ("mine", 600, 576)
    assert [s.name for s in mine.stages] == [s.name for s in base.stages]
    one, two = ({s.name: s.settings for s in x.stages} for x in (mine, base))
    assert {n for n in one if one[n] != two[n]} == {"tof_taps"}
    assert one["tof_taps"]["halo"].bounds() == (0.05, 0.05)
    assert one["tof_taps"]["read_variance"] == two["tof_taps"]["read_variance"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('extends = "azure-kinct"', "no such sensor 'azure-kinct'"),
        ("extends = 3", "extends must be the name of a sensor, not 3"),
        ('extends = "mine.toml"', "extends itself"),
        ('extends = "ideal"\n[[stage]]\nuse = "axial"', "changes the stage 'axial', which ideal"),
        ('extends = "azure-kinect"\n[stage]\nuse = "axial"', "write each stage as a table"),
    ],
)
def test_a_bad_extension_is_named(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(f'{text.splitlines()[0]}\ntitle = "t"\n' + "\n".join(text.splitlines()[1:]))
    with pytest.raises(ConfigError, match=message) as caught:
        load_sensor(str(file))
    assert "\n" not in str(caught.value)


def test_code_of_a_file_that_is_extended_is_found_and_asked_for(tmp_path: Path) -> None:
    """Python code in the other file needs the same trust as one's own."""
    (tmp_path / "base").mkdir()
    (tmp_path / "base" / "own.toml").write_text(
        (SENSOR_FOLDER / "ideal.toml").read_text() + '[[stage]]\nuse = "code.py:quiet"\n'
    )
    mine = tmp_path / "mine.toml"
    mine.write_text('extends = "base/own.toml"\ntitle = "mine"\n')
    settings = load_settings(None, [], {"sensor": str(mine)}, {})
    assert sensor_code(settings) == [f"{tmp_path / 'base' / 'code.py'}:quiet"]


@pytest.mark.parametrize(
    ("sensor", "z_m", "kept"),
    [
        ("kinect-v2", 0.495, False),
        ("kinect-v2", 0.505, True),
        ("kinect-v2", 4.49, True),
        ("kinect-v2", 4.51, False),
        ("kinect-v1", 0.69, False),
        ("kinect-v1", 0.71, True),
        ("kinect-v1", 5.99, True),
        ("kinect-v1", 6.01, False),
        ("kinect-v2-paper", 6.01, False),
    ],
)
def test_ranges_are_those_of_the_device(
    context: moderngl.Context, sensor: str, z_m: float, kept: bool
) -> None:
    frame = on_plane(context, sensor, z_m, "range_gate")
    assert ((frame.noisy_m > 0) == kept).all()
    expected = Reason.VALID if kept else Reason.OUT_OF_RANGE
    assert (frame.reason_codes == expected).all()


def test_dark_surfaces_are_lost_by_the_kinect_v2(context: moderngl.Context) -> None:
    """Half of the pixels at 387 of 30,300 counts: an albedo of 0.0128 at 1 m, facing."""
    plane = Plane(1.0, 0).mesh(0.02)
    dark = Mesh(plane.vertices_mm, plane.faces, np.full(4, 387.468 / 30_300, np.float32))
    off = {"shadow", "lateral", "axial", "fixed_pattern", "edge_dropout"}
    settings = settings_for(
        "kinect-v2-fankhauser", stage={name: {"enabled": False} for name in off}
    )
    frames = frames_of(context, at_distance(settings, 1.0), moved(dark, 1.0), 40)
    lost = np.concatenate([(f.noisy == 0)[f.clean > 0] for f in frames])
    assert len(lost) > 5000
    # At the edge of the patch slanted rays lose 3e-4 of the light, negligible against 16 counts.
    assert abs(z_rate(lost, 0.5)) < Z_MAX
    codes = np.concatenate([f.reason[(f.noisy == 0) & (f.clean > 0)] for f in frames])
    assert (codes == Reason.LOW_SIGNAL).all()


@pytest.mark.parametrize("z_m", [0.7, 2.0])
def test_infrared_falls_with_the_square_of_the_distance(
    context: moderngl.Context, z_m: float
) -> None:
    """30,300 counts from white paper at 1 m, as in real frames; skin has 0.6 of it."""
    frame = on_plane(context, "kinect-v2-fankhauser", z_m, "infrared")
    assert frame.infrared.max() == pytest.approx(0.6 * 30_300 / z_m**2, rel=1e-4, abs=0.6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("width = 7", "rig.width: .*greater than or equal to 8"),
        ("focal_px = [0, 100]", "rig: focal_px must be at least 1"),
        ("near_m = 20", r"rig: near_m 20.0 must be less than far_m 12.0"),
        ("widht = 96", r"no such setting 'rig.widht' .did you mean 'width'"),
        ('deliver = "cooked"', "rig.deliver: 'cooked' is not one of undistorted, raw"),
        ("[rig.distortion]\nk7 = 1", r"no such setting 'rig.distortion.k7' .known: k1, k2, k3"),
        ("[[rig.emitter]]\nposition_m = [0, 0, 0]", "an emitter at the camera itself throws no"),
        ("[[rig.emitter]]\nposition_m = [0, 0]", "rig.emitter.0.position_m.2: is missing"),
    ],
)
def test_a_bad_rig_is_named(tmp_path: Path, change: str, message: str) -> None:
    file = Path(sensor_file(tmp_path))
    key = change.split(" =")[0]
    lines = [line for line in file.read_text().splitlines() if not line.startswith(f"{key} =")]
    file.write_text("\n".join([*lines, change]))
    with pytest.raises(ConfigError, match=message):
        load_sensor(str(file))


def test_the_rig_may_be_changed_from_settings(context: moderngl.Context) -> None:
    settings = settings_for("kinect-v2", rig={"deliver": "raw", "width": 400})
    (frame,) = frames_of(context, settings, face_mesh())
    assert frame.clean.shape == (424, 400)
    assert load_sensor("kinect-v2", None, {"deliver": "raw"}).rig.keeps_distortion
    with pytest.raises(ConfigError, match=r"no such setting 'rig.delivers'"):
        load_sensor("kinect-v2", None, {"delivers": "raw"})


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("axial.base_sigma_mm=-3", "base_sigma_mm"),
        ("axial.base_sigma=3", "base_sigma"),
        ("axil.base_sigma_mm=3", "has no stage 'axil'"),
        ("rig.width=2", "rig.width"),
        ("rig.focal=3", "focal"),
    ],
)
def test_an_error_of_set_names_the_text_that_the_user_wrote(text: str, problem: str) -> None:
    sensor = {"sensor": "kinect-v2-fankhauser"}
    settings = load_settings(None, ["axial.angle_mm=0.2", text, "seed=4"], sensor)
    with pytest.raises(ConfigError) as error:
        sensor_of(settings)
    assert str(error.value).startswith(f"--set {text}: ")
    assert problem in str(error.value)
