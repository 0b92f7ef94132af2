"""A cluster whose head is gone is one line, before Ray ends the process from C++."""

import os
import socket
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from glsim.core.errors import DatasetError
from glsim.data import ray_cluster
from tests.support.ray_nodes import ray_nodes

RUN = """
import sys, time
from glsim.data import ray_cluster
from glsim.core.errors import DatasetError
ray_cluster._SILENT_S = 2.0
def nap(_, seconds):
    time.sleep(seconds)
try:
    with ray_cluster.ray_cluster(sys.argv[1]) as ray:
        for _ in ray_cluster.run_tasks(ray, nap, None, ((n, (0.2,)) for n in range(10_000))):
            print("one", flush=True)
except DatasetError as error:
    print(f"error: {error}", flush=True)
"""


class RayError(Exception):
    """Of the stand-in for Ray."""


class GetTimeoutError(RayError):
    """Of the stand-in for Ray."""


def stand_in(address: str, call: Callable[[], Any], through_client: bool = False) -> Any:
    """Return what of Ray is used here; each of its functions is ``call``."""

    def function(*_: object, **__: object) -> Any:
        return call()

    errors = {n: type(n, (RayError,), {}) for n in ("RayTaskError", "RuntimeEnvSetupError")}
    return SimpleNamespace(
        get=function,
        cancel=function,
        remote=function,
        nodes=function,
        get_runtime_context=lambda: SimpleNamespace(gcs_address=address),
        util=SimpleNamespace(
            client=SimpleNamespace(ray=SimpleNamespace(is_connected=lambda: through_client))
        ),
        exceptions=SimpleNamespace(RayError=RayError, GetTimeoutError=GetTimeoutError, **errors),
    )


def fail(error: Exception) -> Callable[[], Any]:
    def call() -> Any:
        raise error

    return call


@pytest.fixture
def silent(monkeypatch: pytest.MonkeyPatch) -> str:
    """An address of this machine at which nothing answers, soon given up."""
    monkeypatch.setattr(ray_cluster, "_SILENT_S", 0.0)
    monkeypatch.setattr("time.sleep", lambda _: None)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        return f"127.0.0.1:{listening.getsockname()[1]}"


def test_a_silent_head_is_given_up(silent: str) -> None:
    match = rf"^the head of the Ray cluster at {silent} does not answer any more \(Connection refu"
    with pytest.raises(DatasetError, match=match):
        ray_cluster.cluster_cores(stand_in(silent, dict))
    with pytest.raises(DatasetError, match=match):
        ray_cluster.task_result(stand_in(silent, fail(GetTimeoutError())), None, 0)


def test_a_head_that_answers_is_waited_for() -> None:
    answers = iter([GetTimeoutError(), GetTimeoutError(), None])

    def call() -> str:
        error = next(answers)
        if error is not None:
            raise error
        return "made"

    with socket.create_server(("127.0.0.1", 0)) as listening:
        ray = stand_in(f"127.0.0.1:{listening.getsockname()[1]}", call)
        assert ray_cluster.task_result(ray, None, 0) == "made"


@pytest.mark.parametrize("error", [OSError("Broken\npipe"), RayError("Broken\npipe")])
def test_errors_of_the_connection_are_one_line(silent: str, error: Exception) -> None:
    """Through ray:// nothing is asked of the head itself."""
    ray = stand_in(silent, fail(error), through_client=True)
    with pytest.raises(DatasetError, match=r"^the connection .* lost \(Broken pipe\): what is"):
        list(ray_cluster.run_tasks(ray, print, None, [(1, ())]))


@pytest.mark.long
def test_a_killed_head_is_one_line() -> None:
    pytest.importorskip("ray", reason="needs pip install 'glsim[ray]'")
    root = str(Path(__file__).parents[2])
    with ray_nodes() as nodes:
        nodes.add()
        process = subprocess.Popen(
            [sys.executable, "-c", RUN, nodes.address],
            env=os.environ | {"PYTHONPATH": root},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stdout.readline() == "one\n"
        nodes.kill_head()
        output, errors = process.communicate()
    assert process.returncode == 0
    assert output.splitlines()[-1].startswith(
        f"error: the head of the Ray cluster at {nodes.address}"
    )
    assert "GCS" not in errors
