"""Connection to a Ray cluster, and execution of a bounded number of calls at a time.

Ray restarts the tasks of a dead node on another node. Actors pinned to it would wait for ever.
"""

from __future__ import annotations

import logging
import os
import signal
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from typing import Any, TypeVar

from glsim.core.errors import (
    ConfigError,
    DatasetError,
    DeviceError,
    GlsimError,
    ShaderError,
    pip_install,
)
from glsim.data.code_version import code_version
from glsim.data.worker_processes import SINGLE_THREADED, WorkerFailure

log = logging.getLogger(__name__)
_T = TypeVar("_T")

#: Errors of a node, not of a frame: its files, its driver, or what a store allows it.
_UNFIT = (ConfigError, DeviceError, ShaderError)

#: Number of started tasks per core: while one runs, the next already waits on the node.
TASKS_PER_CORE = 2
#: Largest number of restarts of a task whose process or node died. Nodes die for many reasons, but
#: a task that kills each process must not run for ever.
_RETRIES = 10
#: Seconds between two counts of the cluster's cores, since nodes join and leave.
_CORES_EVERY_S = 2.0
#: Seconds within which the head of a cluster accepts a connection.
_ANSWER_S = 10.0
#: First bytes of a connection of HTTP/2 (RFC 9113), which Ray uses: a preface and empty settings;
#: and the kind of the server's first answer, in its fourth byte.
_HTTP2_BEGIN = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes((0, 0, 0, 4, 0, 0, 0, 0, 0))
_HTTP2_SETTINGS = b"\x04"
#: Seconds after which a silent head counts as lost; after 60 s Ray would end this process silently.
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
        raise ConfigError(f"a cluster needs Ray: {pip_install('ray')}") from None
    if ray.is_initialized():
        yield ray
        return
    _check_answers(address)
    on_sigterm = signal.getsignal(signal.SIGTERM)
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
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, on_sigterm)  # Ray's own handler prints a stack trace
    try:
        yield ray
    finally:
        ray.shutdown()


def _check_answers(address: str) -> None:
    """Raise ConfigError if no server of HTTP/2 answers at HOST:PORT; Ray would try for minutes."""
    host, separator, port = address.removeprefix("ray://").rpartition(":")
    if not separator or not (port.isascii() and port.isdigit()):
        return
    try:
        with socket.create_connection((host.strip("[]"), int(port)), _ANSWER_S / 2) as server:
            server.settimeout(_ANSWER_S / 2)
            server.sendall(_HTTP2_BEGIN)
            if server.recv(4)[3:] != _HTTP2_SETTINGS and not os.environ.get("RAY_USE_TLS"):
                raise OSError("it is no port of Ray")
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
        f"{what} ({why}): what is complete is kept: restart the cluster, then run the same command"
    )


@contextmanager
def _connection_errors(ray: Any) -> Iterator[None]:
    try:
        yield
    except (OSError, ray.exceptions.RayError) as error:
        raise _lost("the connection to the Ray cluster is lost", error) from error


def cluster_cores(ray: Any, unfit: Collection[str] = ()) -> int:
    """Return the number of cores of all nodes, without those whose identifiers are ``unfit``."""
    _refuse_silent_head(ray)
    nodes = [n for n in ray.nodes() if n["Alive"] and n["NodeID"] not in unfit]
    return int(sum(node["Resources"].get("CPU", 0) for node in nodes))


def _caller() -> Callable[..., Any]:
    """Return the function of all tasks, which is sent as code: a node may have another glsim."""

    def call(expected: str, pickled: bytes, shared: list[Any]) -> tuple[str, str, str | None, Any]:
        """Return the node, its host, which other glsim it has (or None), and the result."""
        import pickle
        import socket

        import ray

        node, host = ray.get_runtime_context().get_node_id(), socket.gethostname()
        try:
            from glsim.data.code_version import code_version

            if (found := f"glsim {code_version()}") == expected:
                function, arguments = pickle.loads(pickled)
                return node, host, None, function(shared, *arguments)
        except ImportError as error:
            found = f"no glsim that works ({error})"
        return node, host, f"{host} has {found}, the driver {expected}: install the same", None

    return call


def run_tasks(
    ray: Any, function: Callable[..., object], shared: object,
    calls: Iterable[tuple[_T, tuple[Any, ...]]], environment: Mapping[str, str] | None = None,
) -> Generator[tuple[_T, Any], None, None]:  # fmt: skip
    """Call a function on the cluster; yield (name, result) of each call in any order.

    A node whose glsim is another, or which reports in a ``WorkerFailure`` that it cannot work, is
    left out with a warning. Raises the other errors in WorkerFailures, the error of the last node
    if none is left, and DatasetError for a call whose processes die repeatedly.

    Args:
        function: called with a list that holds the reference of ``shared``, and with the arguments.
        calls: name and arguments of each call, taken when there is a core for it.
    """
    variables = {"env_vars": SINGLE_THREADED | dict(environment or {})}
    options = {"num_cpus": 1, "max_retries": _RETRIES, "runtime_env": variables}
    source, again = iter(calls), deque[tuple[_T, tuple[Any, ...]]]()
    running: dict[Any, tuple[_T, tuple[Any, ...]]] = {}
    nodes = _Nodes(ray)
    try:
        with _connection_errors(ray):
            remote, given = ray.remote(_caller()), [ray.put(shared)]
            task, version = remote.options(**options), f"glsim {code_version()}"
            while True:
                nodes.count()
                while len(running) < max(1, TASKS_PER_CORE * nodes.cores):
                    call = again.popleft() if again else next(source, None)
                    if call is None:
                        break
                    pickled = ray.cloudpickle.dumps((function, call[1]))
                    running[task.remote(version, pickled, given)] = call
                if not running:
                    return
                done, _ = ray.wait(list(running), num_returns=1, timeout=_CORES_EVERY_S)
                for reference in done:
                    call = running.pop(reference)
                    node, host, other, result = task_result(ray, reference, call[0])
                    if other is None and not isinstance(result, WorkerFailure):
                        yield call[0], result
                        continue
                    error = ConfigError(other) if other else result.error
                    if not isinstance(error, _UNFIT):
                        raise error
                    others = nodes.leave_out(node, host, error)
                    task = remote.options(**options, scheduling_strategy=others)
                    again.append(call)
    except ClusterLostError:
        running.clear()  # cancelling tasks now sometimes makes Ray abort the process
        raise
    finally:
        with suppress(OSError, ray.exceptions.RayError):
            for reference in running:
                ray.cancel(reference, force=True)


class _Nodes:
    """The nodes of a cluster that can do the work, and the number of their cores."""

    def __init__(self, ray: Any) -> None:
        self._ray = ray
        self.cores, self._counted_s = -1, float("-inf")
        self._unfit: set[str] = set()

    def count(self) -> None:
        """Count the cores again after some seconds, and warn if there are none."""
        if time.monotonic() - self._counted_s < _CORES_EVERY_S:
            return
        before, self.cores = self.cores, cluster_cores(self._ray, self._unfit)
        self._counted_s = time.monotonic()
        if self.cores != before:
            text = "" if self.cores else ": waiting for a node"
            level = logging.INFO if self.cores else logging.WARNING
            log.log(level, "the Ray cluster has %d cores%s", self.cores, text)

    def leave_out(self, node: str, host: str, error: GlsimError) -> Any:
        """Return Ray's strategy for the other nodes; raise the error if no node is left."""
        from ray.util.scheduling_strategies import NodeLabelSchedulingStrategy, NotIn

        if node not in self._unfit:
            self._unfit.add(node)
            self.cores = cluster_cores(self._ray, self._unfit)
            if not self.cores:
                raise error
            log.warning("node %s (%s) is left out: %s", host, node[:8], error)
        # Each node has its identifier as a label.
        return NodeLabelSchedulingStrategy({"ray.io/node-id": NotIn(*self._unfit)})


def task_result(ray: Any, reference: Any, name: object) -> Any:
    """Return the result of the Ray task of a call. Raises DatasetError if its processes die."""
    while True:
        try:
            return ray.get(reference, timeout=_CORES_EVERY_S)
        except ray.exceptions.GetTimeoutError:  # without the timeout: for ever, if the head is gone
            _refuse_silent_head(ray)
        except ray.exceptions.RayTaskError as error:
            text = " ".join(f"{type(error.cause).__name__}: {error.cause}".split())
            raise ConfigError(
                f"a node of the cluster cannot run glsim: {text[:300]}: install the same on all"
            ) from error
        except ray.exceptions.RuntimeEnvSetupError as error:
            raise ConfigError(f"a node of the cluster cannot start workers: {error}") from error
        except ray.exceptions.RayError as error:
            text = " ".join(str(error).split())
            raise DatasetError(
                f"processes of the cluster die while they do task {name} (out of memory?): "
                f"{text[:200]}: what is complete is kept; run the same command again to continue"
            ) from error
