"""Classical filters of depth maps: the paper's filters, mask-aware filters, temporal filters."""
