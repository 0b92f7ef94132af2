"""Comparison of two sets of depth frames, real or simulated, by measures and a classifier.

``comparison`` measures both sets. ``patches`` and ``classifier`` test whether a classifier can
distinguish them. ``replay`` renders the surfaces of a real set through a simulated sensor.
"""
