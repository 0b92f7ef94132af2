"""Compare two sets of depth frames, real or simulated, measure by measure.

``comparison`` measures both sets, ``patches`` and ``classifier`` tell them apart, ``replay``
renders the second set of the first.
"""
