"""Validation of sensors against published measurements: ``validate_sensor("kinect-v2")``."""

from glsim.bench.validate.captures import Captures
from glsim.bench.validate.run import run_checks, validate_sensor
from glsim.bench.validate.virtual_camera import VirtualCamera

__all__ = ["Captures", "VirtualCamera", "run_checks", "validate_sensor"]
