"""Say which camera made an unlabelled recording: evidence, known cameras, and a ranked answer."""
