"""Scoring of denoisers on real recordings, which have no clean truth: ``glsim eval-real``."""
