"""Measure the noise of a camera on a recording and write a sensor file (``glsim fit``)."""
