"""Reproduction of the paper: its tables and figures, with printed values beside our values."""
