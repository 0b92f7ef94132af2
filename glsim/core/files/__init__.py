"""Files: atomic writing, data sets on disk and in clouds, JSON, images, EXR and NPY."""
