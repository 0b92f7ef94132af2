"""The commands of ``glsim`` that belong to training."""
