"""Measure the noise of a real camera on a recording and write a sensor file (``glsim fit``)."""

from glsim.fit.fixed_pattern import FixedPattern
from glsim.fit.noise_model import (
    InfraredLaw,
    LightProfile,
    NoiseModel,
    TapNoise,
    fit_infrared,
    fit_noise_model,
)
from glsim.fit.recording import Recording, read_recording
from glsim.fit.recording_statistics import RecordingStatistics, measure_recording
from glsim.fit.sensor_file import (
    LEAST_PATTERN_FRAMES,
    base_profile,
    base_sensor,
    base_taps,
    fitted_values,
    knows_pattern,
    sensor_toml,
    unplaced_parameters,
)
from glsim.fit.wiggling import Wiggling, fit_wiggling

__all__ = [
    "LEAST_PATTERN_FRAMES",
    "FixedPattern",
    "InfraredLaw",
    "LightProfile",
    "NoiseModel",
    "Recording",
    "RecordingStatistics",
    "TapNoise",
    "Wiggling",
    "base_profile",
    "base_sensor",
    "base_taps",
    "fit_infrared",
    "fit_noise_model",
    "fit_wiggling",
    "fitted_values",
    "knows_pattern",
    "measure_recording",
    "read_recording",
    "sensor_toml",
    "unplaced_parameters",
]
