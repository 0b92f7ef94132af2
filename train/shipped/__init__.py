"""The network that comes with glsim, ``face.pt``: see docs/model_card.md."""
