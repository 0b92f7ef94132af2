"""Data sets on disk: generate, resume, verify, read, import and export them.

``driver`` runs a generation, or a part of one, by the steps in ``dataset_run``; ``chunk_writer``
renders and writes the chunks, in the driver or in worker processes; ``reader`` reads the result.
"""
