"""Chunks on a cluster of Ray: whatever becomes of its nodes, the bytes are those of a local run."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from glsim.core.errors import ConfigError, DatasetError, MeshError
from glsim.core.files.cloud import open_store
from glsim.data.dataset_run import DatasetRun, run_all
from glsim.data.driver import generate
from glsim.data.progress import FrameProgress, GenerateSummary
from glsim.data.ray_cluster import ray_cluster
from glsim.data.ray_renderer import on_ray
from glsim.data.verification import verify
from glsim.settings.schema import load_settings
from tests.support.dataset_fakes import (
    SENSOR,
    Fault,
    contents,
    fake_frames,
    make,
    make_settings,
    make_tasks,
)
from tests.support.ray_nodes import Nodes, connected_nodes

pytestmark = pytest.mark.filterwarnings("ignore")  # Ray leaves files and sockets open
TASKS = make_tasks(4, 40)


@pytest.fixture(scope="module")
def nodes() -> Iterator[Nodes]:
    with connected_nodes() as nodes:
        yield nodes


def make_on_ray(
    out: Path, nodes: Nodes, progress: Callable[[FrameProgress], None] | None = None, settings=None,
    **faults,
) -> GenerateSummary:  # fmt: skip
    make_frames = partial(fake_frames, **faults)
    store = open_store(out)
    run = DatasetRun(
        settings or make_settings(), TASKS, store, make_frames, SENSOR, "fake renderer"
    )
    return run_all(run, on_ray(nodes.address), progress)


@pytest.mark.long
@pytest.mark.parametrize("format", ["png", "webdataset"])
def test_a_cluster_makes_the_bytes_of_a_local_run(
    tmp_path: Path, nodes: Nodes, format: str
) -> None:
    settings = make_settings(format=format)
    seen: list[FrameProgress] = []
    make(tmp_path / "local", settings, TASKS, skip_every=7)
    summary = make_on_ray(tmp_path / "ray", nodes, seen.append, settings, skip_every=7)
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")
    assert (summary.rendered, sum(summary.skipped.values())) == (160, 22)
    assert seen[-1].done == seen[-1].total == 160
    assert make_on_ray(tmp_path / "ray", nodes, settings=settings).reused == 160


@pytest.mark.long
def test_a_killed_node_costs_work_and_no_bytes(tmp_path: Path, nodes: Nodes) -> None:
    """The node dies after the first chunk; the others arrive from those that are left."""
    make(tmp_path / "local", tasks=TASKS)
    second = nodes.add()
    killed: list[Any] = []

    def kill_one(progress: FrameProgress) -> None:
        if progress.done and not killed:
            killed.append(progress.done)
            nodes.kill(second)

    summary = make_on_ray(tmp_path / "ray", nodes, kill_one, delay_s=0.01)
    assert killed
    assert killed[0] < 160
    assert summary.rendered == 160
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")
    assert verify(tmp_path / "ray", deep=True) == []


#: What the interpreters of a node run first: it has no glsim, or that of another commit.
NONE = "import sys; sys.modules['glsim'] = None"
OTHER = "import sys, types; sys.modules['glsim.data.code_version'] = types.SimpleNamespace"
OTHER += "(code_version=lambda: '0.1.0+other')"


@pytest.mark.long
def test_nodes_that_cannot_work_are_left_out_by_name(
    tmp_path: Path, nodes: Nodes, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    added = []
    for name, code in {"none": NONE, "other": OTHER, "refused": ""}.items():
        (tmp_path / name).mkdir()
        (tmp_path / name / "sitecustomize.py").write_text(code)
        with monkeypatch.context() as patch:
            patch.setenv("PYTHONPATH", str(tmp_path / name))
            patch.setenv("UNFIT", "1") if name == "refused" else None
            added.append(nodes.add())
    make(tmp_path / "local", tasks=TASKS)
    assert make_on_ray(tmp_path / "ray", nodes, refuse="UNFIT", delay_s=0.02).rendered == 160
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")
    left_out = [r.getMessage() for r in caplog.records if "is left out" in r.getMessage()]
    reasons = ("has no glsim that works (No module", "glsim 0.1.0+other, the driver", "denied")
    assert [sum(reason in line for line in left_out) for reason in reasons] == [1, 1, 1], left_out
    for node in added:
        nodes.kill(node)


@pytest.mark.long
def test_a_process_that_dies_once_is_replaced(tmp_path: Path, nodes: Nodes) -> None:
    once = str(tmp_path / "once")
    make_on_ray(tmp_path / "ray", nodes, faults=(Fault("kill", 70, once),))
    make(tmp_path / "local", tasks=TASKS)
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")


@pytest.mark.long
def test_a_chunk_that_kills_every_process_ends_the_run(
    tmp_path: Path, nodes: Nodes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("glsim.data.ray_cluster._RETRIES", 1)
    with pytest.raises(DatasetError, match="processes of the cluster die while they do task"):
        make_on_ray(tmp_path / "ray", nodes, faults=(Fault("kill", 70),))


@pytest.mark.long
def test_errors_of_the_simulator_arrive_as_they_are(tmp_path: Path, nodes: Nodes) -> None:
    with pytest.raises(MeshError, match="the mesh has a hole"):
        make_on_ray(tmp_path / "ray", nodes, faults=(Fault("mesh", 50),))
    make_on_ray(tmp_path / "ray", nodes)
    make(tmp_path / "local", tasks=TASKS)
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")


@pytest.mark.long
def test_generate_renders_on_a_cluster(tmp_path: Path, nodes: Nodes) -> None:
    """With the real simulator, which each process keeps from chunk to chunk."""
    overrides = {"source": {"kind": "procedural", "subjects": 4, "frames_per_subject": 10}}
    settings = load_settings(overrides=overrides | {"output": {"crop": 32}})
    generate(settings, tmp_path / "local", workers=1)
    generate(settings, tmp_path / "ray", ray=nodes.address)
    assert contents(tmp_path / "ray") == contents(tmp_path / "local")


def test_an_address_without_a_cluster_is_an_error() -> None:
    ray = pytest.importorskip("ray")
    if ray.is_initialized():
        pytest.skip("this process is connected to a cluster")
    with pytest.raises(ConfigError, match="Ray at"), ray_cluster("nowhere"):
        pass
