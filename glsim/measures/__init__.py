"""Measures of depth frames, real or simulated; each file measures one property.

``measured_frame``, ``static``, ``correlation``, ``pixel_runs`` and ``quadrics`` are shared helpers.
"""
