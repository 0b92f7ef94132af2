"""The paper's figures 1 to 5, drawn from a reproduction, and figure 6, drawn with our networks."""
