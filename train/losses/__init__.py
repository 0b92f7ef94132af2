"""Training losses: supervised, self-supervised, and the registry of their kinds."""
