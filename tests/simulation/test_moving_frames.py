"""Motion within the exposure: frames at rest are unchanged, and moving ones follow the physics."""

from typing import Any

import numpy as np
import pytest
from moderngl import Context
from numpy.typing import NDArray

from glsim.core.camera import Exposure
from glsim.core.errors import ConfigError
from glsim.core.mesh import Mesh
from glsim.core.reason import Reason
from glsim.settings.schema import load_settings
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import Simulator, open_sources, simulate
from glsim.simulation.plan.tasks import make_tasks
from tests.support.scenes import face_mesh, frames_of, rectangle, settings_for

STILL: dict[str, Any] = {"pose": {"distance_mm": 900}, "motion": {"within_exposure": True}}
#: No noise that would hide what motion does.
QUIET = {
    "tof_taps": {"read_variance": 0.0, "shot_variance": 0.0, "companding": False},
    "tof_light": {"harmonic_2": 0.0, "harmonic_5": 0.0, "indirect": 0.0},
    "tof_floor": {"enabled": False},
    "fixed_pattern": {"enabled": False},
    "millimetre_quantise": {"enabled": False},
}


def shot(context: Context, sensor: str, mesh: Mesh | None = None, **overrides: Any) -> Frame:
    return frames_of(context, settings_for(sensor, **overrides), mesh or face_mesh())[0]


def same(one: Frame, other: Frame) -> bool:
    return all(
        getattr(one, n).tobytes() == getattr(other, n).tobytes()
        for n in ("clean", "noisy", "reason", "infrared_counts", "noisy_m")
    )


def wall() -> Mesh:
    """A wall at the origin of the face, wider than any view."""
    return rectangle((-3.0, 3.0), (-3.0, 3.0), 0.0)


@pytest.mark.parametrize(
    ("sensor", "exposure"),
    [("azure-kinect", {}), ("kinect-v2", {}), ("kinect-v1", {"read_out_ms": 20.0})],
)
def test_a_frame_at_rest_has_the_same_bytes(
    context: Context, sensor: str, exposure: dict[str, float]
) -> None:
    rig = {"exposure": exposure} if exposure else {}
    off = shot(context, sensor, rig=rig, pose={"distance_mm": 900})
    on = shot(context, sensor, rig=rig, **STILL)
    assert same(off, on)
    turning = {**STILL, "motion": {"within_exposure": True, "yaw_deg_s": 200}}
    assert not same(off, shot(context, sensor, rig=rig, **turning))
    unused = {**STILL, "motion": {"within_exposure": False, "yaw_deg_s": 200}}
    assert same(off, shot(context, sensor, rig=rig, **unused))


@pytest.mark.parametrize("sensor", ["azure-kinect", "kinect-v2"])
def test_captures_of_a_scene_at_rest_add_up_to_its_light(context: Context, sensor: str) -> None:
    """A scene that moves by less than 1 um has the depth of a scene at rest."""
    slow = {**STILL, "motion": {"within_exposure": True, "x_mm_s": 1e-3}}
    one = shot(context, sensor, pose={"distance_mm": 900}, stage=QUIET)
    nine = shot(context, sensor, stage=QUIET, **slow)
    both = (one.noisy_m > 0) & (nine.noisy_m > 0)
    assert ((one.noisy_m > 0) == (nine.noisy_m > 0)).mean() > 0.999
    assert 1000 * np.abs(one.noisy_m - nine.noisy_m)[both].max() < 0.2
    assert one.clean.tobytes() == nine.clean.tobytes()


def test_a_wall_that_recedes_is_measured_as_the_formula_says(context: Context) -> None:
    """A receding wall turns the phase between the taps: the twin of the sum, in NumPy."""
    speed_mm_s, z_m = 2000.0, 0.9
    moving = {**STILL, "motion": {"within_exposure": True, "z_mm_s": speed_mm_s}}
    frame = shot(context, "azure-kinect", wall(), stage=QUIET, output={"crop": 64}, **moving)
    sensor = Simulator(settings_for("azure-kinect"), [], context).sensor
    exposure, mhz = sensor.rig.exposure, sensor.rig.modulation_mhz
    emitter = np.array(sensor.rig.emitter_m)
    phasors = np.zeros(3, complex)
    for part in exposure.parts():
        assert part.capture is not None
        point = np.array([0.0, 0.0, z_m + 1e-6 * speed_mm_s * part.time_ms])
        path = 0.5 * (np.linalg.norm(point) + np.linalg.norm(point - emitter))
        way = np.linalg.norm(point - emitter)
        light = np.exp(2j * np.pi * path * mhz[part.capture // 3] / 150) * point[2] / way**3
        turn = np.exp(2j * np.pi * (part.capture % 3) / 3)
        phasors[part.capture // 3] += 2 / 3 * np.conj(turn) * (light * turn).real
    true = 0.5 * (z_m + np.linalg.norm([*(-emitter[:2]), z_m]))
    cycles = true * np.array(mhz) / 150
    error = np.angle(phasors * np.exp(-2j * np.pi * cycles)) / (2 * np.pi)
    expected_mm = 1000 * error.sum() * 150 / sum(mhz)
    own = slice(24, 40)
    found_mm = 1000 * (frame.noisy_m - frame.clean_m)[own, own].mean()
    assert abs(expected_mm) > 1.0
    assert found_mm == pytest.approx(expected_mm, rel=0.1, abs=0.1)


def centroid(image: NDArray[np.bool_], rows: slice) -> float:
    """Mean column of the true pixels of some rows."""
    return float(np.nonzero(image[rows])[1].mean())


def test_a_rolling_shutter_leans_what_moves_sideways(context: Context) -> None:
    """Rows at the top are earlier: at 1 m/s and 30 ms a bar leans by 30 mm over the image."""
    bar = rectangle((-0.03, 0.03), (-0.3, 0.3), 0.0)
    rig = {"exposure": {"read_out_ms": 30.0, "bands": 30}}
    moving = {**STILL, "motion": {"within_exposure": True, "x_mm_s": 1000.0}}
    still = shot(context, "ideal", bar, rig=rig, pose={"distance_mm": 900})
    frame = shot(context, "ideal", bar, rig=rig, **moving)
    assert frame.clean.tobytes() == still.clean.tobytes()  # the truth is that of the instant
    height, focal = frame.intrinsics.height, frame.intrinsics.fx
    seen = np.zeros((height, frame.intrinsics.width), bool)
    truth = seen.copy()
    seen[frame.window.slices] = frame.noisy_m > 0
    truth[frame.window.slices] = frame.clean_m > 0
    for row in (height // 4, height // 2, 3 * height // 4):
        rows = slice(row - 2, row + 2)
        expected_px = 1000.0 * 0.030 * (row / height - 0.5) / 900 * focal
        lean_px = centroid(seen, rows) - centroid(truth, rows)
        assert lean_px == pytest.approx(expected_px, abs=0.6), row
    gone = (frame.noisy == 0) & (frame.clean > 0)
    grown = (frame.noisy > 0) & (frame.clean == 0)
    assert gone.sum() > 100
    assert (frame.reason[gone] == Reason.DROPPED).all()
    assert (frame.reason[grown] == Reason.GROWN).all()
    assert (frame.reason[(frame.noisy > 0) & (frame.clean > 0)] == Reason.VALID).all()


def test_faster_turns_have_larger_errors_at_the_rim(context: Context) -> None:
    errors = []
    for speed in (0.0, 180.0, 720.0):
        motion = {"within_exposure": True, "yaw_deg_s": speed}
        frame = shot(context, "azure-kinect", pose={"distance_mm": 900}, motion=motion, stage=QUIET)
        both = (frame.noisy_m > 0) & (frame.clean_m > 0)
        errors.append(float(np.abs(frame.noisy_m - frame.clean_m)[both].mean()) * 1000)
    assert errors[0] < errors[1] < errors[2]
    assert errors[2] > 1.5 * errors[0]


@pytest.mark.long
def test_moving_frames_do_not_depend_on_their_batch(context: Context) -> None:
    """A generated sequence whose head and face move: each frame alone, and all together."""
    overrides = {"sensor": "azure-kinect", "motion": {"within_exposure": True}}
    settings = load_settings(None, [], overrides, {"subjects": 1, "frames_per_subject": 3})
    together = list(simulate(settings, context=context))
    sources = open_sources(settings)
    for task, expected in reversed(list(zip(make_tasks(settings, sources), together, strict=True))):
        (alone,) = simulate(settings, [task], context=context)
        assert isinstance(alone, Frame)
        assert isinstance(expected, Frame)
        assert same(alone, expected)


def test_times_are_those_of_the_data_sheet() -> None:
    parts = Exposure(captures=9, spacing_ms=1.575).parts()
    times = np.array([part.time_ms for part in parts])
    assert times.mean() == pytest.approx(0.0)
    assert np.ptp(times) + 0.125 == pytest.approx(12.725)  # Microsoft: 12.8 ms
    bands = Exposure(read_out_ms=20.0, bands=10).parts()
    assert [b.time_ms for b in bands] == pytest.approx(np.arange(-9.0, 10.0, 2.0))
    assert bands[0].rows == (0.0, 0.1)
    assert Exposure().parts() == ()


@pytest.mark.parametrize(
    ("sensor", "rig", "message"),
    [
        ("ideal", {}, "does not say when its frame is exposed"),
        ("ideal", {"exposure": {"captures": 9, "spacing_ms": 1.5}}, "has no stage tof_light"),
        ("ideal", {"exposure": {"captures": 9, "read_out_ms": 9}}, "give captures or read_out_ms"),
    ],
)
def test_sensors_that_cannot_show_motion_are_named(
    context: Context, sensor: str, rig: dict[str, object], message: str
) -> None:
    settings = settings_for(sensor, rig=rig, motion={"within_exposure": True})
    with pytest.raises(ConfigError, match=message):
        Simulator(settings, [], context)
