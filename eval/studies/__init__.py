"""Studies that generate data, train networks and score them."""
