"""The Plan of a data set: the subject, source, split and seeds of each frame."""
