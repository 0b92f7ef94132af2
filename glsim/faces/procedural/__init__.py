"""Procedural heads: a parametric human head written in NumPy, no data file.

Where to look: volumes.py has the anatomy as soft volumes; grid.py and topology.py the mesh;
eyes.py, mouth.py, ears.py the features; template.py puts the mean head together; parameters.py
lists what varies between people and identity*.py how; actions.py lists the FACS action units and
expression.py applies them; subject.py makes a person, source.py the face source.

Frame: millimetres, +x the subject's left, +y up, +z out of the face. The origin lies in the median
plane midway between the nasion (y = 24) and the base of the nose (y = -29.5 and below); the tip of
the nose is near z = 40, the pupils near z = 7, the tragus near z = -80, the back of the head near
z = -175.
"""

from glsim.faces.procedural.parameters import PARAMETERS, Parameter, sample_identity
from glsim.faces.procedural.regions import REGIONS
from glsim.faces.procedural.source import ProceduralFaces

__all__ = ["PARAMETERS", "REGIONS", "Parameter", "ProceduralFaces", "sample_identity"]
