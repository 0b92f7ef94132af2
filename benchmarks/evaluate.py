"""Time and peak memory of Table 1: ``python -m benchmarks.evaluate DATASET``.

DATASET: e.g. ``glsim generate -o bench --subjects 22 --frames-per-subject 100 --crop 128
--split 0,0.05,0.95 --sensor kinect-v2-paper``. Scores its validation split, then the larger test
split; the memory of a process must not grow with the split.
"""

import argparse
import resource
import tempfile
import time
from pathlib import Path

from glsim.data.worker_processes import available_workers
from glsim.denoise.registry import PAPER_FILTERS
from glsim.eval.report.score_tables import table_markdown
from glsim.eval.scoring.blocks import ScoringJob
from glsim.eval.scoring.evaluate import evaluate


def measure(dataset: Path, split: str) -> None:
    """Print time and peak memory of the paper's five columns on one split."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        evaluation = evaluate(ScoringJob(dataset, split, PAPER_FILTERS), Path(folder))
        scored = time.perf_counter()
        table_markdown(evaluation, evaluation.summary.table(), split)
        end = time.perf_counter()
    parent, workers = (
        resource.getrusage(who).ru_maxrss / 1024
        for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    )
    print(
        f"{split}: {evaluation.frames} frames x {len(PAPER_FILTERS)} methods on "
        f"{available_workers()} cores: {scored - start:.1f} s, tables {end - scored:.1f} s; "
        f"peak memory {parent:.0f} MB of the parent, {workers:.0f} MB of a worker"
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", type=Path)
    arguments = parser.parse_args()
    for name in ("val", "test"):
        measure(arguments.dataset, name)
