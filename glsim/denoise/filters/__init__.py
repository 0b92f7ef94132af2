"""Classical filters: the paper's, mask-aware ones, and temporal ones."""
