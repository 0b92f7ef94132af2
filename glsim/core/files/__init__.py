"""Atomic file writing, JSON, and PNG images."""
