"""Sculpt the embedded heads: the arrays in ``glsim/faces/procedural/heads.npz``. See README.md."""
