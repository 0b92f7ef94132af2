"""Sensors against what is published about them: ``validate("kinect-v2")`` gives a Report."""

from glsim.validate.bench import Bench
from glsim.validate.figure import check_matplotlib, figure
from glsim.validate.lab import Lab
from glsim.validate.report import Report, band_texts, measured_texts
from glsim.validate.run import examine, validate

__all__ = [
    "Bench",
    "Lab",
    "Report",
    "band_texts",
    "check_matplotlib",
    "examine",
    "figure",
    "measured_texts",
    "validate",
]
