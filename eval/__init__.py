"""Evaluation of denoisers of depth frames: metrics, scoring, reports, and the paper's tables.

Installed as ``glsim.eval``. The simulator imports nothing from it.
"""
