"""Data sets on disk: making, resuming, checking and reading them."""

from glsim.dataset.checks import verify
from glsim.dataset.images import write_frame
from glsim.dataset.reader import Dataset, Pair, Split, open_dataset
from glsim.dataset.run import Progress, Summary, Workers, available_workers, generate, write_dataset
from glsim.dataset.work import FrameMaker

__all__ = [
    "Dataset",
    "FrameMaker",
    "Pair",
    "Progress",
    "Split",
    "Summary",
    "Workers",
    "available_workers",
    "generate",
    "open_dataset",
    "verify",
    "write_dataset",
    "write_frame",
]
