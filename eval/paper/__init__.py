"""The paper's tables, which compare printed values with our measured values."""
