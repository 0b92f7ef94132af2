"""Training pairs, from a data set on disk or rendered during the training.

Each pair is ``(noisy_mm, clean_mm)``: (1, H, W) float32 millimetres, 0 = no return.
docs/howto/training_data.md shows whole training scripts. Import the classes from ``glsim.train``.
"""
