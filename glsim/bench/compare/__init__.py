"""Comparison of two sets of depth frames, real or simulated, by measures and a classifier.

``comparison`` measures both sets, ``patches`` and ``classifier`` tell them apart, ``replay``
renders the second set of the first.
"""
