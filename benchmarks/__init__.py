"""Measurements against peers. Each file with a main is one command: python -m benchmarks.NAME."""
