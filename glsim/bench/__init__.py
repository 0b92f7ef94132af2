"""Hold simulated frames against theory and real recordings: measure, check, compare and fit."""
