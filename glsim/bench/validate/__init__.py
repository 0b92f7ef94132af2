"""Validation of sensors against published measurements: ``validate_sensor("kinect-v2")``."""

from glsim.bench.validate.captures import Captures
from glsim.bench.validate.run import run_checks, validate_sensor

__all__ = ["Captures", "run_checks", "validate_sensor"]
