"""Pairs that a cluster renders: the batches of a rendering here, whatever becomes of the nodes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import torch

from glsim.settings.schema import Settings, load_settings
from glsim.train.data import ray_blocks
from glsim.train.data.simulated import SimulatedPairs
from tests.support.ray_nodes import Nodes, connected_nodes

#: Ray leaves files and sockets open.
pytestmark = [pytest.mark.long, pytest.mark.filterwarnings("ignore")]


@pytest.fixture(scope="module")
def nodes() -> Iterator[Nodes]:
    with connected_nodes() as nodes:
        yield nodes


def small(**source) -> Settings:
    source = {"kind": "procedural", "subjects": 6, "frames_per_subject": 8} | source
    return load_settings(overrides={"source": source, "output": {"crop": 16}})


def batches(length: int, **options) -> list[tuple[torch.Tensor, torch.Tensor]]:
    pairs = SimulatedPairs(small(), batch=2, seed=5, length=length, reuse=2, **options)
    return list(pairs.loader(0 if "ray" not in options else 3))


def same(found, expected) -> bool:
    return len(found) == len(expected) and all(
        torch.equal(a, b)
        for x, y in zip(found, expected, strict=True)
        for a, b in zip(x, y, strict=True)
    )


@pytest.mark.long
def test_the_batches_are_those_of_a_rendering_here(nodes: Nodes) -> None:
    expected = batches(110)
    assert same(batches(110, ray=nodes.address), expected)
    assert same(batches(6, start=104, ray=nodes.address), expected[104:])


@pytest.mark.long
def test_a_killed_node_changes_no_batch(nodes: Nodes) -> None:
    expected = batches(40)
    second = nodes.add()
    pairs = SimulatedPairs(small(), batch=2, seed=5, length=40, reuse=2, ray=nodes.address)
    found = []
    for number, batch in enumerate(pairs):
        if number == 3:
            nodes.kill(second)
        found.append(batch)
    assert same(found, expected)


@pytest.mark.long
def test_nodes_do_not_run_far_ahead(nodes: Nodes, monkeypatch: pytest.MonkeyPatch) -> None:
    submitted = []
    submit = ray_blocks.RayBlocks._submit_next

    def counted(self: ray_blocks.RayBlocks) -> None:
        submitted.append(1)
        submit(self)

    monkeypatch.setattr(ray_blocks.RayBlocks, "_submit_next", counted)
    pairs: Any = iter(SimulatedPairs(small(), batch=2, seed=5, ray=nodes.address))
    next(pairs)
    assert len(submitted) == 12 + 1  # LANES ahead, and the one in use
    pairs.close()
