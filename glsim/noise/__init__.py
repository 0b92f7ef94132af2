"""Noise stages: their declarations, the chain that runs them, and their NumPy twins."""
