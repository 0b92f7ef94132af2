"""The metrics, in files by what they measure; ``score`` finds every ``Metric`` in them."""
