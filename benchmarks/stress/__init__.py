"""Stress tests as commands: ``python -m benchmarks.stress NAME``."""
