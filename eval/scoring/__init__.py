"""Scoring of denoisers on a set of frames: pairs, workers, statistics, tuning."""
