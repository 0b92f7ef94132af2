"""Validate sensors against published measurements: ``validate_sensor("kinect-v2")``."""

from glsim.validate.captures import Captures
from glsim.validate.figure import draw_figure
from glsim.validate.report import ValidationReport, band_texts, measured_texts
from glsim.validate.run import run_checks, validate_sensor
from glsim.validate.virtual_camera import VirtualCamera

__all__ = [
    "Captures",
    "ValidationReport",
    "VirtualCamera",
    "band_texts",
    "draw_figure",
    "measured_texts",
    "run_checks",
    "validate_sensor",
]
