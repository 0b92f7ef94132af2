"""Noise stages of depth cameras: their declarations, the chain that runs them, NumPy twins."""
