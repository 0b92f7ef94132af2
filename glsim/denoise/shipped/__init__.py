"""The network shipped with glsim, ``face.pt``: see docs/model_card.md."""
