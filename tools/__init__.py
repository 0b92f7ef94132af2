"""Tools of the repository that no package ships."""
