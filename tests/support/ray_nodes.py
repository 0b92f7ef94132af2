"""A local Ray cluster of several nodes, each with its own processes, which tests can kill."""

import logging
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

#: Bytes of each node's object store: some hundred small chunks.
_STORE_BYTES = 100_000_000


class Nodes:
    """A Ray cluster of a head without cores, and nodes of one core each."""

    def __init__(self) -> None:
        from ray.cluster_utils import Cluster

        self._cluster = Cluster(
            initialize_head=True,
            shutdown_at_exit=False,  # its signal handlers allow no nodes from other threads
            head_node_args={
                "num_cpus": 0,
                "object_store_memory": _STORE_BYTES,
                "include_dashboard": False,
                "no_monitor": True,  # nothing is scaled
            },
        )
        self.address: str = self._cluster.address

    def add(self, cores: int = 1) -> Any:
        """Start a node and return it."""
        return self._cluster.add_node(num_cpus=cores, object_store_memory=_STORE_BYTES)

    def kill(self, node: Any) -> None:
        """Kill a node and its workers with SIGKILL, as a power cut does."""
        processes = [p.process.pid for each in node.all_processes.values() for p in each]
        for pid in [pid for process in processes for pid in _below(process)]:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self._cluster.remove_node(node, allow_graceful=False)

    def kill_head(self) -> None:
        """Kill the processes of the head with SIGKILL."""
        for each in self._cluster.head_node.all_processes.values():
            for process in each:
                for pid in _below(process.process.pid):
                    with suppress(ProcessLookupError):
                        os.kill(pid, signal.SIGKILL)

    def stop(self) -> None:
        """End all nodes."""
        self._cluster.shutdown()


def _below(process: int) -> list[int]:
    """Return a process and all its descendants, the process first."""
    found, waiting = [], [process]
    while waiting:
        pid = waiting.pop()
        found.append(pid)
        with suppress(OSError):
            for task in Path(f"/proc/{pid}/task").iterdir():
                waiting += map(int, (task / "children").read_text().split())
    return found


@contextmanager
def connected_nodes() -> Iterator[Nodes]:
    """Run a cluster of one node, and connect this process to it. Skips the test without Ray."""
    ray = pytest.importorskip("ray", reason="needs pip install 'glsim[ray]'")
    with ray_nodes() as nodes:
        nodes.add()
        ray.init(address=nodes.address, log_to_driver=False, logging_level=logging.ERROR)
        yield nodes
        ray.shutdown()


@contextmanager
def ray_nodes() -> Iterator[Nodes]:
    """Start a Ray cluster, and stop it at the end of the ``with`` block."""
    nodes = Nodes()
    try:
        yield nodes
    finally:
        nodes.stop()
