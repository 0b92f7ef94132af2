"""Metrics of one frame: ``definitions`` lists them, ``score`` computes them."""
