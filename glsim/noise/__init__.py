"""Noise stages of depth cameras: declarations, the chain that runs them, and their NumPy twins."""
