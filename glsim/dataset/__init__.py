"""Data sets on disk: generate, resume, verify and read them.

``driver`` runs a generation; ``chunk_writer`` renders and writes the chunks, in the driver or in
each ``worker_process``; ``reader`` reads the result.
"""

from glsim.dataset.chunk_writer import FrameMaker
from glsim.dataset.driver import GenerateProgress, GenerateSummary, generate, write_dataset
from glsim.dataset.layer_images import write_frame
from glsim.dataset.reader import Dataset, Pair, Split, open_dataset
from glsim.dataset.shard_samples import webdataset_decoder
from glsim.dataset.verification import verify
from glsim.worker_processes import Workers, available_workers

# Deprecated names of version 0.1.
Progress = GenerateProgress
Summary = GenerateSummary

__all__ = [
    "Dataset",
    "FrameMaker",
    "GenerateProgress",
    "GenerateSummary",
    "Pair",
    "Progress",
    "Split",
    "Summary",
    "Workers",
    "available_workers",
    "generate",
    "open_dataset",
    "verify",
    "webdataset_decoder",
    "write_dataset",
    "write_frame",
]
