"""How long Table 1 takes, and how much memory: ``python -m benchmarks.evaluate DATASET``.

DATASET: e.g. ``glsim generate -o bench --subjects 22 --frames-per-subject 100 --crop 128
--split 0,0.05,0.95 --sensor kinect-v2-paper``. Scores its validation split and then
the larger test split; the memory of a process must not grow with the set.
"""

from __future__ import annotations

import argparse
import resource
import tempfile
import time
from pathlib import Path

from glsim.dataset import available_workers
from glsim.eval.blocks import Scoring
from glsim.eval.denoisers import PAPER
from glsim.eval.run import evaluate
from glsim.eval.tables import markdown


def measure(dataset: Path, split: str) -> None:
    """Time and peak memory of the paper's five columns on one split."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        found = evaluate(Scoring(dataset, split, PAPER), Path(folder))
        scored = time.perf_counter()
        markdown(found, found.summary.compared(), split)
        end = time.perf_counter()
    parent, workers = (
        resource.getrusage(who).ru_maxrss / 1024
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    print(
        f"{split}: {found.frames} frames x {len(PAPER)} methods on {available_workers()} cores: "
        f"{scored - start:.1f} s, tables {end - scored:.1f} s; "
        f"peak of the parent {parent:.0f} MB, of a worker {workers:.0f} MB"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", type=Path)
    arguments = parser.parse_args()
    for name in ("val", "test"):
        measure(arguments.dataset, name)
