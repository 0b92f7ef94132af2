"""Measure the noise of a real camera on a recording and write a sensor file (``glsim fit``)."""

from glsim.fit.noise_model import NoiseModel, fit_noise_model
from glsim.fit.recording import Recording, read_recording
from glsim.fit.recording_statistics import RecordingStatistics, measure_recording
from glsim.fit.sensor_file import base_sensor, fitted_values, sensor_toml

__all__ = [
    "NoiseModel",
    "Recording",
    "RecordingStatistics",
    "base_sensor",
    "fit_noise_model",
    "fitted_values",
    "measure_recording",
    "read_recording",
    "sensor_toml",
]
