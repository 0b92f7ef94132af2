"""Noise in the programs of others: robot learning."""
