"""Data sets on disk: generate, resume, verify and read them.

``driver`` runs a generation, or a part of one, by the steps in ``dataset_run``; ``chunk_writer``
renders and writes the chunks, in the driver or in worker processes; ``reader`` reads the result.
"""

from glsim.dataset.cards import write_cards
from glsim.dataset.chunk_writer import FrameMaker
from glsim.dataset.driver import (
    generate,
    generate_part,
    write_dataset,
)
from glsim.dataset.layer_images import webdataset_decoder, write_frame
from glsim.dataset.parts import Part, parse_part
from glsim.dataset.progress import GenerateProgress, GenerateSummary, PartSummary
from glsim.dataset.reader import Dataset, open_dataset
from glsim.dataset.verification import verify
from glsim.worker_processes import Workers, available_workers

__all__ = [
    "Dataset",
    "FrameMaker",
    "GenerateProgress",
    "GenerateSummary",
    "Part",
    "PartSummary",
    "Workers",
    "available_workers",
    "generate",
    "generate_part",
    "open_dataset",
    "parse_part",
    "verify",
    "webdataset_decoder",
    "write_cards",
    "write_dataset",
    "write_frame",
]
