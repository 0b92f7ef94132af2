"""Comparison of simulated frames with theory and real recordings: check, compare, fit."""
