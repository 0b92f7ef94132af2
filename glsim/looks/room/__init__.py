"""The scene around a person: what stands behind and beside the face, drawn from the seeds."""
