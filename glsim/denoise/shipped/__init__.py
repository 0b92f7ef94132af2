"""The network shipped with glsim, ``face.onnx``: see docs/model_card.md."""
