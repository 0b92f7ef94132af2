"""Trains denoisers of depth frames on simulated pairs: models, recipes, data, checkpoints.

Installed as ``glsim.train``; the folder stands at the top because it is a layer above the
simulator, which knows nothing of it.
"""
