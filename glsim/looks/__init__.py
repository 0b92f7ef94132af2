"""Hair, beards, brows, glasses and clothes: meshes over a face, and the rooms around a person."""
