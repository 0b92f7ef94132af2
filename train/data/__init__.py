"""Pairs of noisy and clean depth for training, from disk or simulated on the fly."""
