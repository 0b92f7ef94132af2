"""The room around a person, sampled from the seeds: walls, furniture and other people."""
