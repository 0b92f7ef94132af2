"""Shipped sensors: they load, their reasons fit the depth, their noise is as published."""

from pathlib import Path

import numpy as np
import pytest
from moderngl import Context

from glsim.core.camera import DEFAULT_INTRINSICS, DEFAULT_SENSOR
from glsim.core.errors import ConfigError
from glsim.core.reason import Reason
from glsim.sensors.sensor import load_sensor, sensor_names, sensor_of
from tests.support.scenes import face_mesh, frames_of, sensor_file, settings_for

SENSORS = sensor_names()


def test_all_of_them_are_known() -> None:
    azure = [f"azure-kinect{mode}" for mode in ("", "-nfov-binned", "-wfov", "-wfov-unbinned")]
    v1 = [f"kinect-v1{model}" for model in ("", "-nguyen", "-pattern")]
    v2 = [f"kinect-v2{model}" for model in ("", "-fankhauser", "-fast", "-paper", "-sdk")]
    models = ("05", "15", "15-high-accuracy", "35", "35-high-accuracy", "35-vga", "55", "xx-fast")
    d4 = [f"realsense-d4{model}" for model in models]
    ours = ["any-depth-camera", *azure, "femto-bolt", "ideal", *v1, *v2, "led3d", "oak-d-pro", *d4]
    assert [*ours, "truedepth", "truedepth-filtered"] == SENSORS
    with pytest.raises(ConfigError, match=r"no such sensor 'kinect-v3' .did you mean 'kinect-v"):
        load_sensor("kinect-v3")
    with pytest.raises(ConfigError, match=r"absent\.toml: no such file"):
        load_sensor("absent.toml")


def test_maps_without_a_camera_have_the_intrinsics_of_the_default_sensor() -> None:
    assert load_sensor(DEFAULT_SENSOR).rig.intrinsics == DEFAULT_INTRINSICS


@pytest.mark.parametrize("name", SENSORS)
def test_a_face_is_seen_with_reasons_that_fit(context: Context, name: str) -> None:
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


def test_daylight_reaches_the_stage_that_knows_it(context: Context) -> None:
    """The light of an overcast sky makes a Kinect V2 noisier; statistical sensors refuse it."""
    noise_mm = []
    for day in (None, 0.04):
        scene, pose = {"daylight": day} if day else {}, {"distance_mm": 2000}
        settings = settings_for("kinect-v2", scene=scene, pose=pose)
        (frame,) = frames_of(context, settings, face_mesh())
        both = (frame.clean > 0) & (frame.noisy > 0)
        noise_mm.append(np.median(np.abs(frame.noisy.astype(float) - frame.clean)[both]))
    assert noise_mm[1] > 2 * noise_mm[0]
    with pytest.raises(ConfigError, match="no stage of sensor"):
        sensor_of(settings_for("kinect-v2-fankhauser", scene={"daylight": 0.04}))


def test_ideal_is_the_clean_depth_rounded(context: Context) -> None:
    (frame,) = frames_of(context, settings_for("ideal"), face_mesh())
    np.testing.assert_array_equal(frame.noisy, frame.clean)
    np.testing.assert_allclose(frame.noisy_m, frame.clean_m, atol=0.000501)
    assert (frame.reason[frame.clean > 0] == Reason.VALID).all()


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
    with pytest.raises(ConfigError, match=key):
        load_sensor("kinect-v2", rig_overrides={key: value})


def test_a_file_says_only_what_differs_from_the_one_it_extends(tmp_path: Path) -> None:
    other = tmp_path / "mine.toml"
    other.write_text(
        'extends = "femto-bolt"\ntitle = "mine"\n[rig]\nwidth = 600\n'
        '[[stage]]\nuse = "tof_taps"\nhalo = 0.05\n[[stage]]\nuse = "gaussian"\n'
    )
    mine, base = load_sensor(str(other)), load_sensor("azure-kinect")
    assert (mine.title, mine.rig.intrinsics.width, mine.rig.intrinsics.height) == ("mine", 600, 576)
    assert [s.name for s in mine.stages] == [*(s.name for s in base.stages), "gaussian"]
    one, two = ({s.name: s.settings for s in x.stages} for x in (mine, base))
    assert {n for n in two if one[n] != two[n]} == {"tof_taps"}
    assert one["tof_taps"]["halo"].bounds() == (0.05, 0.05)
    assert one["tof_taps"]["read_variance"] == two["tof_taps"]["read_variance"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('extends = "azure-kinct"', "no such sensor 'azure-kinct'"),
        ("extends = 3", "extends must be the name of a sensor, not 3"),
        ('extends = "mine.toml"', "extends itself"),
        ('extends = "azure-kinect"\nbinning = 3', "binning must be 1, 2 or 4, not 3"),
        ('extends = "ideal"\n[[stage]]\nuse = "axail"', "axail"),
        ('extends = "azure-kinect"\n[stage]\nuse = "axial"', "write each stage as a table"),
    ],
)
def test_a_bad_extension_is_named(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(f'{text.splitlines()[0]}\ntitle = "t"\n' + "\n".join(text.splitlines()[1:]))
    with pytest.raises(ConfigError, match=message):
        load_sensor(str(file))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("width = 7", "rig.width: .*greater than or equal to 8"),
        ("focal_px = [0, 100]", "rig.focal_px.0: must be greater than or equal to 1"),
        ("near_m = 20", r"rig: near_m 20.0 must be less than far_m 12.0"),
        ("widht = 96", r"no such setting 'rig.widht' .did you mean 'rig.width'"),
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


def test_the_rig_may_be_changed_from_settings(context: Context) -> None:
    settings = settings_for("kinect-v2", rig={"deliver": "raw", "width": 400})
    (frame,) = frames_of(context, settings, face_mesh())
    assert frame.clean.shape == (424, 400)
    assert load_sensor("kinect-v2", None, {"deliver": "raw"}).rig.keeps_distortion
    with pytest.raises(ConfigError, match=r"no such setting 'rig.delivers'"):
        load_sensor("kinect-v2", None, {"delivers": "raw"})
