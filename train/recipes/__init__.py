"""Shipped recipes of ``glsim train``; each file holds only what differs from its base."""
