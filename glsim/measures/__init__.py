"""Measures of depth frames, real or simulated: one file per fact.

``measured_frame``, ``static``, ``correlation``, ``pixel_runs`` and ``quadrics`` serve the others.
"""
