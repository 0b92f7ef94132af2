"""Connection to a Ray cluster, and execution of a bounded number of calls at a time.

Ray restarts the tasks of a dead node on another node. Actors pinned to it would wait for ever.
"""

from __future__ import annotations

import logging
import os
import socket
import time
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from itertools import islice
from typing import Any, TypeVar

from glsim.core.errors import ConfigError, DatasetError
from glsim.data.worker_processes import SINGLE_THREADED, WorkerFailure

log = logging.getLogger(__name__)
_T = TypeVar("_T")

#: Number of started tasks per core: while one runs, the next already waits on the node.
TASKS_PER_CORE = 2
#: Largest number of restarts of a task whose process or node died. Nodes die for many reasons, but
#: a task that kills each process must not run for ever.
_RETRIES = 10
#: Seconds between two counts of the cluster's cores, since nodes join and leave.
_CORES_EVERY_S = 2.0
#: Seconds within which the head of a cluster accepts a connection.
_ANSWER_S = 10.0
#: Seconds after which a silent head counts as lost; after 60 s Ray would end this process without
#: an error.
_SILENT_S = 30.0


@contextmanager
def ray_cluster(address: str) -> Iterator[Any]:
    """Connect to a Ray cluster, or use the open connection, and yield the module ray.

    ``address``: "auto" (the cluster of this machine), "host:6379", "ray://host:10001", or "local"
    (a new cluster, as long as this process). Raises ConfigError without a cluster or without Ray.
    """
    try:
        import ray
    except ImportError:
        raise ConfigError("a cluster needs Ray: pip install 'glsim[ray]'") from None
    if ray.is_initialized():
        yield ray
        return
    _check_answers(address)
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")  # a "local" cluster reports to its vendor
    try:
        ray.init(address=address, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, TimeoutError):
        raise ConfigError(
            f"Ray at {address}: no cluster answers: start one with ray start --head, and name "
            "host:6379, or auto on a machine of the cluster"
        ) from None
    except (ValueError, RuntimeError) as error:  # another version of Ray or Python
        text = " ".join(str(error).split())
        raise ConfigError(f"Ray at {address}: {text[:300]}") from None
    try:
        yield ray
    finally:
        ray.shutdown()


def _check_answers(address: str) -> None:
    """Raise ConfigError if HOST:PORT does not answer, because Ray would try for minutes."""
    host, separator, port = address.removeprefix("ray://").rpartition(":")
    if not separator or not (port.isascii() and port.isdigit()):
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), _ANSWER_S).close()
    except (OSError, OverflowError) as error:
        why = getattr(error, "strerror", None) or error
        raise ConfigError(
            f"Ray at {address}: nothing answers ({why}): start a cluster with ray start --head, "
            "and name its host:6379"
        ) from None


def _refuse_silent_head(ray: Any) -> None:
    """Wait until the cluster's head accepts connections; raise ClusterLostError after _SILENT_S."""
    if ray.util.client.ray.is_connected():
        return  # with ray://, the head's own address may be unreachable
    address = ray.get_runtime_context().gcs_address
    host, _, port = address.rpartition(":")
    give_up_s = time.monotonic() + _SILENT_S
    while True:
        try:
            socket.create_connection((host.strip("[]"), int(port)), _ANSWER_S).close()
            return
        except OSError as error:
            if time.monotonic() > give_up_s:
                head = f"the head of the Ray cluster at {address}"
                raise _lost(f"{head} does not answer any more", error) from None
        time.sleep(1)


class ClusterLostError(DatasetError):
    """The error that the connection to the Ray cluster is lost."""


def _lost(what: str, error: Exception) -> ClusterLostError:
    why = " ".join(str(getattr(error, "strerror", None) or error).split())[:200]
    return ClusterLostError(
        f"{what} ({why}): what is complete is kept: start the cluster again, then run the same "
        "command"
    )


@contextmanager
def _connection_errors(ray: Any) -> Iterator[None]:
    """Convert Ray's connection errors in the block to ClusterLostError."""
    try:
        yield
    except (OSError, ray.exceptions.RayError) as error:
        raise _lost("the connection to the Ray cluster is lost", error) from error


def cluster_cores(ray: Any) -> int:
    """Return the number of cores of all nodes. Raises ClusterLostError if unreachable."""
    _refuse_silent_head(ray)
    with _connection_errors(ray):
        return int(ray.cluster_resources().get("CPU", 0))


def run_tasks(
    ray: Any,
    function: Callable[..., object],
    calls: Iterable[tuple[_T, tuple[Any, ...]]],
    environment: Mapping[str, str] | None = None,
) -> Generator[tuple[_T, Any], None, None]:
    """Call a function on the cluster; yield (name, result) of each call in any order.

    Raises the error of a call, which returns a ``WorkerFailure``, and DatasetError for a call whose
    processes die repeatedly.

    Args:
        ray: the module, connected to the cluster.
        function: a function of a module that every node has.
        calls: name and arguments of each call, taken when there is a core for it.
        environment: variables for the processes of the nodes.
    """
    variables = {"env_vars": SINGLE_THREADED | dict(environment or {})}
    task = ray.remote(function).options(num_cpus=1, max_retries=_RETRIES, runtime_env=variables)
    source = iter(calls)
    running: dict[Any, _T] = {}
    cores, looked_s = 0, float("-inf")
    try:
        while True:
            if time.monotonic() - looked_s > _CORES_EVERY_S:
                before, cores, looked_s = cores, cluster_cores(ray), time.monotonic()
                if before != cores:
                    log.info("the cluster has %d cores", cores)
            free = max(1, TASKS_PER_CORE * cores) - len(running)
            for name, arguments in islice(source, max(free, 0)):
                running[start_task(ray, task, *arguments)] = name
            if not running:
                return
            with _connection_errors(ray):
                done, _ = ray.wait(list(running), num_returns=1, timeout=_CORES_EVERY_S)
            for reference in done:
                name = running.pop(reference)
                yield name, task_result(ray, reference, name)
    except ClusterLostError:
        running.clear()  # cancelling tasks now sometimes makes Ray abort the process
        raise
    finally:
        cancel_tasks(ray, running)


def start_task(ray: Any, task: Any, *arguments: object) -> Any:
    """Start a Ray task; return the reference of its result. Raises ClusterLostError."""
    with _connection_errors(ray):
        return task.remote(*arguments)


def cancel_tasks(ray: Any, references: Iterable[Any]) -> None:
    """Cancel Ray tasks whose results are no longer needed; do nothing without a cluster."""
    with suppress(OSError, ray.exceptions.RayError):
        for reference in references:
            ray.cancel(reference, force=True)


def task_result(ray: Any, reference: Any, name: object) -> Any:
    """Wait for the result of the Ray task of a call and return it.

    Raises the error in a ``WorkerFailure``, DatasetError if the processes die repeatedly, or
    ClusterLostError if the cluster is gone.
    """
    try:
        result = _wait_for(ray, reference)
    except ray.exceptions.RayTaskError as error:
        text = " ".join(str(error.cause).split())
        raise ConfigError(
            f"a node of the cluster cannot run glsim: {type(error.cause).__name__}: {text[:300]}: "
            "install the same glsim and its extras on every node"
        ) from error
    except ray.exceptions.RuntimeEnvSetupError as error:
        raise ConfigError(f"a node of the cluster cannot start workers: {error}") from error
    except ray.exceptions.RayError as error:
        text = " ".join(str(error).split())
        raise DatasetError(
            f"processes of the cluster die while they do task {name} (out of memory?): "
            f"{text[:200]}: what is complete is kept; run the same command again to continue"
        ) from error
    if isinstance(result, WorkerFailure):
        raise result.error
    return result


def _wait_for(ray: Any, reference: Any) -> Any:
    while True:
        try:
            return ray.get(reference, timeout=_CORES_EVERY_S)
        except ray.exceptions.GetTimeoutError:  # without the timeout: for ever, if the head is gone
            _refuse_silent_head(ray)
        except OSError as error:
            raise _lost("the connection to the Ray cluster is lost", error) from error
