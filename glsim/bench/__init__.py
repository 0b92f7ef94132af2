"""Comparison of simulated frames with theory (validate) and with real recordings (compare, fit)."""
