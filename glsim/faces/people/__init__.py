"""Whole people: a parametric body with a face that performs action units."""
