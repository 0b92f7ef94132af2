"""What a person wears: hair, beard, brows, glasses and cloth, as parts over the mesh of a face."""
