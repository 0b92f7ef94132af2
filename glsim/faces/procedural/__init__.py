"""Embedded heads: a model of 60 identity parameters and 24 action units, built by ``tools/heads``.

Frame: millimetres, +x the subject's left, +y up, +z out of the face. The origin lies in the median
plane midway between the nasion (y = 24) and the base of the nose (y = -29.5 and below); the tip of
the nose is near z = 40, the pupils near z = 7, the tragus near z = -80, the back of the head near
z = -175, the notch between the clavicles near y = -165, and the bust ends near y = -500.
"""
