"""The paper's tables: printed values beside measured ones."""
