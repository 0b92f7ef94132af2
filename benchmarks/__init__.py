"""Side-by-side measurements against peers. Each file is one command: python -m benchmarks.NAME."""
