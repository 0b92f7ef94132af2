"""Transfer: networks on sensors and faces that were not in training, beside tuned filters."""
