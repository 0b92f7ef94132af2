"""Blocks of pairs that the nodes of a Ray cluster render during the training."""

from __future__ import annotations

import uuid
from contextlib import ExitStack
from itertools import count
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from glsim.data.arithmetic import Machine, this_machine
from glsim.data.ray_cluster import (
    TASKS_PER_CORE,
    LostResultError,
    cancel_tasks,
    cluster_cores,
    failure_of,
    ray_cluster,
    remote_task,
    start_task,
    task_result,
)
from glsim.data.worker_processes import WorkerFailure
from glsim.gl.context import open_context
from glsim.simulation.pipeline import Simulator
from glsim.train.data.stream import LANES, BatchPlace, BatchStream


class MadeBlock(NamedTuple):
    """The pairs of a block, (pairs, C + 1, H, W) float32, and the machine that rendered them."""

    pairs: NDArray[np.float32]
    machine: Machine


class RayBlocks:
    """Blocks of pairs of some lanes, rendered on a cluster in the order of their use.

    Nodes run at most LANES blocks, or two a core, ahead of the training; finished blocks wait in
    Ray's object store. Blocks are used in order of number, not of arrival, so the batches
    equal those of a local rendering.

    Raises ConfigError as ``ray_cluster``; ``pairs`` raises the errors of the nodes, and
    ConfigError for a node that computes differently from the first one.

    Args:
        lanes: numbers and first blocks of the lanes, in the order of their use.
    """

    def __init__(self, stream: BatchStream, lanes: list[tuple[int, int]], address: str) -> None:
        self._stack = ExitStack()
        self._ray = self._stack.enter_context(ray_cluster(address))
        self._task = remote_task(self._ray, render_block_on_node)
        self._shared = (uuid.uuid4().hex, [self._ray.put(stream)])
        self._order = ((lane, first + later) for later in count() for lane, first in lanes)
        self._ahead: dict[tuple[int, int], Any] = {}  # block -> reference of its pairs
        self._pairs: dict[tuple[int, int], NDArray[np.float32]] = {}
        self._machine: Machine | None = None

    def pairs(self, place: BatchPlace) -> NDArray[np.float32]:
        """Wait for a batch's block and return its pairs, (pairs, C + 1, H, W) float32."""
        block = (place.lane, place.block)
        self._pairs.pop((place.lane, place.block - 1), None)
        if block not in self._pairs:
            self._submit()
            while block not in self._ahead:  # the training was begun in the middle of a block
                self._submit_next()
            self._pairs[block] = self._wait_for(block)
            self._submit()
        return self._pairs[block]

    def _submit(self) -> None:
        """Submit blocks to the nodes until the limit of unused blocks is reached."""
        while len(self._ahead) < max(LANES, TASKS_PER_CORE * cluster_cores(self._ray)):
            self._submit_next()

    def _submit_next(self) -> None:
        block = next(self._order)
        self._ahead[block] = start_task(self._ray, self._task, *self._shared, *block)

    def _wait_for(self, block: tuple[int, int]) -> NDArray[np.float32]:
        while True:
            try:
                made: MadeBlock = task_result(self._ray, self._ahead.pop(block))
                break
            except LostResultError:
                self._ahead[block] = start_task(self._ray, self._task, *self._shared, *block)
        if self._machine is None:
            self._machine = made.machine
        made.machine.refuse_other(self._machine)
        return made.pairs

    def close(self) -> None:
        """Cancel unfinished blocks and disconnect from the cluster."""
        cancel_tasks(self._ray, self._ahead.values())
        self._ahead.clear()
        self._stack.close()


class _Renderer:
    """The simulator of a worker process of the cluster, which is reused from block to block."""

    def __init__(self, token: str, stream: BatchStream) -> None:
        self.token, self._stream = token, stream
        context = open_context(stream.backend)
        self._machine = this_machine(context)
        self._simulator = Simulator(
            stream.settings, list(stream.sources), context, (), stream.layers
        )

    def render(self, lane: int, block: int) -> MadeBlock:
        frames = list(self._simulator.frames(self._stream.tasks(lane, block)))
        return MadeBlock(np.stack(self._stream.images(frames, lane, block)), self._machine)


_renderer: _Renderer | None = None


def render_block_on_node(
    token: str, reference: list[Any], lane: int, block: int
) -> MadeBlock | WorkerFailure:
    """Render a block on a node; return errors as values, because Ray wraps raised errors."""
    global _renderer
    try:
        if _renderer is None or _renderer.token != token:
            import ray

            _renderer = _Renderer(token, ray.get(reference[0]))
        return _renderer.render(lane, block)
    except Exception as error:
        return failure_of(error)
