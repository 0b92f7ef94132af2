"""Shared code of the readers of face sets on disk: file trees, formats and scales."""
