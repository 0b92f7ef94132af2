"""Comparison of simulated frames with theory and real recordings: measure, check, compare, fit."""
