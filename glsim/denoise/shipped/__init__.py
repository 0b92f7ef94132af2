"""The network shipped with glsim, ``face.onnx``: see docs/results/model_card.md."""
