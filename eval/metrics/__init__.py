"""Metrics of one frame: ``definitions`` lists all metrics, ``score`` computes them."""
