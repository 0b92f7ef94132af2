"""What the readers of face sets on disk share: trees of files, their formats and scales."""
