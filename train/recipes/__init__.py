"""Recipes that ``glsim train`` knows by name; each holds only what differs from its base."""
