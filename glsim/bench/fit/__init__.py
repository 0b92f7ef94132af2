"""Measurement of a camera's noise on a recording, to write a sensor file (``glsim fit``)."""
