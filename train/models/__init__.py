"""Network architectures, one per file, each written from its paper."""
