"""The ICT-FaceKit morphable model."""
