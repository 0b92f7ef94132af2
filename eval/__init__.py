"""Scores denoisers of depth frames: filters, metrics, tables, figures.

Installed as ``glsim.eval``; the folder stands at the top because it is a layer above the
simulator, which knows nothing of it.
"""
