"""Validate sensors against published measurements: ``validate_sensor("kinect-v2")``."""

from glsim.validate.captures import Captures
from glsim.validate.run import run_checks, validate_sensor
from glsim.validate.virtual_camera import VirtualCamera

__all__ = ["Captures", "VirtualCamera", "run_checks", "validate_sensor"]
