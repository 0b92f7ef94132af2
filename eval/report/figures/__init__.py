"""Figures of an evaluation, drawn with Matplotlib (the extra ``eval``)."""
