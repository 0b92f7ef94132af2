"""What found the faults of version 0.1, kept as commands: ``python -m benchmarks.stress NAME``."""
