"""Procedural heads: a parametric human head in NumPy, without data files.

Modules: volumes.py defines the anatomy as soft volumes, signed_distance.py evaluates them; grid.py
and topology.py define the mesh; eyes.py, mouth.py, nose.py, ears.py, teeth.py the features;
template.py builds the mean head with its bust; parameters.py lists the identity parameters and
identity*.py their displacement fields, asymmetry.py makes left and right differ; actions.py lists
the FACS action units and expression.py applies them; neck.py says which vertices follow the head's
pose; subject.py makes a person, source.py the face source.

Frame: millimetres, +x the subject's left, +y up, +z out of the face. The origin lies in the median
plane midway between the nasion (y = 24) and the base of the nose (y = -29.5 and below); the tip of
the nose is near z = 40, the pupils near z = 7, the tragus near z = -80, the back of the head near
z = -175, the notch between the clavicles near y = -165, and the bust ends near y = -500.
"""

from glsim.faces.procedural.parameters import PARAMETERS, IdentityParameter, sample_identity
from glsim.faces.procedural.regions import REGIONS
from glsim.faces.procedural.source import ProceduralFaces

__all__ = ["PARAMETERS", "REGIONS", "IdentityParameter", "ProceduralFaces", "sample_identity"]
