"""Validation sheets as data: which checks a sensor must pass, with bands and sources."""
