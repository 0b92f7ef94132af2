"""A sensor from a recording: ``glsim fit`` measures a camera's noise and writes its sensor file."""

from glsim.fit.model import Model, fit_model
from glsim.fit.recording import Recording, read_recording
from glsim.fit.sensor_file import base_sensor, fitted_values, sensor_text
from glsim.fit.statistics import Statistics, measure

__all__ = [
    "Model",
    "Recording",
    "Statistics",
    "base_sensor",
    "fit_model",
    "fitted_values",
    "measure",
    "read_recording",
    "sensor_text",
]
