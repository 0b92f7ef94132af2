"""Whole people: a parametric body with a face that performs action units."""

from glsim.faces.people.source import People

__all__ = ["People"]
