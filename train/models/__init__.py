"""Networks, each written from its paper, in a file of its own."""
