"""Measurements behind the checks; each function returns measurements by number of check."""
