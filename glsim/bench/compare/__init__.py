"""Compare two sets of depth frames, real or simulated, measure by measure.

``run`` measures both sets, ``patches`` and ``classifier`` tell them apart, ``report`` writes the
table and ``figure`` draws it.
"""
