"""The room around a person, drawn from the seeds: walls, furniture and other people."""
