"""Kill nodes of a Ray cluster that makes a data set, and compare its bytes with a local run's.

    python -m benchmarks.ray_kills [--frames 2000] [--kills 10]

Starts a cluster of Ray on this machine: a head without cores, and two nodes. Makes the data set
once with local worker processes, once on the undisturbed cluster (the overhead), and once for each
kill: a node dies by SIGKILL, with all its workers, at a random moment, and another joins. Prints a
table; the exit status is 1 if any byte differs.
"""

from __future__ import annotations

import argparse
import random
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

from glsim.dataset import generate
from glsim.ray_cluster import ray_cluster
from glsim.settings.schema import Settings, load_settings
from tests.support.dataset_fakes import contents
from tests.support.ray_nodes import Nodes, ray_nodes


def settings_of(frames: int) -> Settings:
    """Return the settings of ``frames`` frames of kinect-v2-paper, 20 a person."""
    source = {"kind": "procedural", "subjects": max(4, frames // 20), "frames_per_subject": 20}
    tree = {"source": source, "sensor": "kinect-v2-paper", "output": {"crop": 128}}
    return load_settings(overrides=tree)


def timed(settings: Settings, out: Path, **options: Any) -> float:
    """Make a data set; return the seconds."""
    started = time.monotonic()
    generate(settings, out, **options)
    return time.monotonic() - started


def kill_and_replace(nodes: Nodes, node: object, after_s: float, joined: list[object]) -> None:
    """Kill a node after some seconds, and let another join."""
    time.sleep(after_s)
    nodes.kill(node)
    joined.append(nodes.add())


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--frames", type=int, default=2000)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    settings, rng = settings_of(options.frames), random.Random(options.seed)
    different = 0
    with tempfile.TemporaryDirectory(prefix="glsim-") as folder, ray_nodes() as nodes:
        root = Path(folder)
        running = [nodes.add(), nodes.add()]
        local_s = timed(settings, root / "local", workers=2)
        expected = contents(root / "local")
        print(f"local, 2 processes: {local_s:.1f} s, {len(expected)} files")
        with ray_cluster(nodes.address):  # one connection for all runs
            timed(settings, root / "warm", ray=nodes.address)
            cluster_s = timed(settings, root / "cluster", ray=nodes.address)
            same = contents(root / "cluster") == expected
            different += not same
            print(f"cluster, 2 nodes: {cluster_s:.1f} s ({cluster_s / local_s - 1:+.0%}), {same=}")
            for number in range(options.kills):
                victim, joined = running.pop(rng.randrange(2)), []  # type: ignore[var-annotated]
                after_s = rng.uniform(0.05, 0.9) * cluster_s
                thread = threading.Thread(
                    target=kill_and_replace, args=(nodes, victim, after_s, joined)
                )
                thread.start()
                out = root / f"kill-{number}"
                seconds = timed(settings, out, ray=nodes.address)
                thread.join()
                running += joined
                same = contents(out) == expected
                different += not same
                print(f"kill {number + 1} after {after_s:.1f} s: {seconds:.1f} s, {same=}")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
