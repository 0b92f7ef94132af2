"""Studies above training and scoring: they generate data, train networks and score them."""
