"""Wiggling of walls at several distances: other harmonics come back; real frames say nothing."""

import numpy as np
import pytest
from moderngl import Context

from glsim.bench import scenes
from glsim.bench.fit.fit_wiggling import fit_wiggling
from glsim.bench.fit.recording_statistics import measure_recording
from glsim.core.camera import Intrinsics
from glsim.core.mesh import Mesh
from glsim.simulation.virtual_camera import VirtualCamera
from tests.support.planted_frames import encoded, frames_of

IMAGE = Intrinsics(512, 424, 365.456, 365.456, 254.878, 205.395)
EMITTER_M = (0.045, 0.0, 0.0)
FRAMES = 12


def walls(slant_deg: float) -> Mesh:
    """Four walls side by side, 0.9 to 2.8 m away, turned about the y axis."""
    distances = (900.0, 1400.0, 2000.0, 2800.0)
    limits = np.linspace(-300.0, 300.0, len(distances) + 1) / IMAGE.fx
    slope = float(np.tan(np.radians(slant_deg)))
    parts = []
    for z, left, right in zip(distances, limits[:-1], limits[1:], strict=True):
        x, half = (left * z, right * z), 450.0 * z / IMAGE.fx
        near, far = (z + slope * (at - 0.5 * (x[0] + x[1])) for at in x)
        parts.append(
            scenes.quad(
                [(x[0], half, near), (x[1], half, far), (x[1], -half, far), (x[0], -half, near)]
            )
        )
    return scenes.merge_meshes(*parts)


@pytest.mark.parametrize("slant_deg", [0.0, pytest.param(35.0, marks=pytest.mark.long)])
def test_harmonics_come_back_from_walls_at_several_distances(
    context: Context, slant_deg: float
) -> None:
    """Sizes within three standard errors as stated, phases within 20 degrees."""
    truth = {2: (0.015, 60.0), 5: (0.006, -100.0)}
    changes = {
        "harmonic_2": 0.015, "harmonic_2_phase_deg": 60.0,
        "harmonic_5": 0.006, "harmonic_5_phase_deg": -100.0,
        "harmonic_phase_spread": 0.0,
    }  # fmt: skip
    camera = VirtualCamera("kinect-v2-fast", context, seed=5)
    shot = camera.capture(walls(slant_deg), FRAMES, None, changes={"tof_fast": changes})
    found = measure_recording(frames_of("walls", encoded(shot), camera=IMAGE))
    wiggling = fit_wiggling(found, IMAGE, EMITTER_M)
    for harmonic, (size, phase_deg) in truth.items():
        assert wiggling.known(harmonic)
        error = wiggling.error[harmonic]
        assert error < 0.1 * 0.015
        assert abs(wiggling.amplitude[harmonic] - size) < 3 * error
        off = np.degrees(wiggling.phase_rad[harmonic]) - phase_deg
        assert np.abs((off + 180) % 360 - 180).max() < 20


def test_a_sensor_without_harmonics_has_none(context: Context) -> None:
    camera = VirtualCamera("kinect-v2-fast", context, seed=5)
    changes = {"tof_fast": {"harmonic_2": 0.0, "harmonic_5": 0.0}}
    shot = camera.capture(walls(35.0), FRAMES, None, changes=changes)
    found = measure_recording(frames_of("walls", encoded(shot), camera=IMAGE))
    wiggling = fit_wiggling(found, IMAGE, EMITTER_M)
    assert not any(wiggling.known(harmonic) for harmonic in (2, 5))
