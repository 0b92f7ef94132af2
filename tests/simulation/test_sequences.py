"""Test draws per frame, drift within sequences, and patterns of devices."""

from pathlib import Path

import numpy as np
from moderngl import Context

from glsim.faces.one_mesh import OneMesh
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import simulate
from glsim.simulation.plan.tasks import Task, make_tasks
from tests.support.scenes import (
    TwoSequences,
    face_mesh,
    frames_of,
    moving_settings,
    plate,
    sensor_file,
    settings_for,
)


def test_what_is_drawn_is_recorded(context: Context) -> None:
    settings = moving_settings(scene={"wall_mm": {"uniform": [1300, 1500]}})
    for frame in frames_of(context, settings, face_mesh(60), 3):
        assert set(frame.pose) == set(type(settings.pose).model_fields) - {"motion"}
        assert 700 <= frame.pose["distance_mm"] <= 1200
        assert frame.pose["pitch_deg"] == 0
        wall_mm = frame.parameters["scene.wall_mm"]
        assert frame.clean[0, 0] == round(wall_mm)


def test_drift_moves_one_field_through_a_sequence(context: Context, tmp_path: Path) -> None:
    """Neighbouring frames are correlated; distant frames and other sequences are not."""

    def fields(drift_hz: float) -> list[np.ndarray]:
        sensor = sensor_file(
            tmp_path,
            f'use = "perlin"\namplitude_mm = 20\nlattice_x_px = 4\nlattice_y_px = 4\n'
            f"drift_hz = {drift_hz}",
        )
        settings = settings_for(sensor)
        results = simulate(settings, sources=[TwoSequences(plate())], context=context)
        return [f.noisy_m[f.clean_m > 0].astype(float) for f in results if isinstance(f, Frame)]

    def alike(a: np.ndarray, b: np.ndarray) -> float:
        return float(np.corrcoef(a, b)[0, 1])

    drifting, still = fields(3.0), fields(0.0)
    assert all(alike(drifting[n], drifting[n + 1]) > 0.8 for n in (*range(11), *range(12, 23)))
    assert abs(alike(drifting[0], drifting[11])) < 0.35
    assert abs(alike(drifting[0], drifting[12])) < 0.35
    assert all(abs(alike(still[n], still[n + 1])) < 0.35 for n in range(23))


def test_devices_have_a_pattern_of_their_own(context: Context, tmp_path: Path) -> None:
    sensor = sensor_file(tmp_path, 'use = "fixed_pattern"\npixel_sigma_mm = 5')
    settings = settings_for(sensor, devices=2, source={"kind": "folder", "subjects": 4})
    patterns = []
    for device, seed in ((0, 1), (0, 2), (1, 1)):
        tasks = make_tasks(settings, [TwoSequences(plate())])
        task = Task(0, "train", "s", 0, tasks[0].key, tasks[0].seeds._replace(frame=seed), device)
        (frame,) = simulate(settings, [task], sources=[OneMesh(plate())], context=context)
        patterns.append(frame.noisy_m)
    np.testing.assert_array_equal(patterns[0], patterns[1])
    inside = patterns[0] > 0
    assert abs(np.corrcoef(patterns[0][inside], patterns[2][inside])[0, 1]) < 0.15
