"""Faces of the ICT-FaceKit morphable model."""

from glsim.faces.ict_facekit.source import IctFaceKit

__all__ = ["IctFaceKit"]
