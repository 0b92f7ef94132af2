"""Networks: one file per architecture, each written from its paper."""
