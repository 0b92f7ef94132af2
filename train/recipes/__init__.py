"""Shipped recipes of ``glsim train``; each file holds only the differences from its base."""
