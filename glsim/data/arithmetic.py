"""A fingerprint of a machine's arithmetic, which depends on processor, libraries and OpenGL driver.

NumPy and the OpenGL driver choose their code by the processor. Frames of two processors look alike
but differ in their bytes, so one data set must not be made on both. The fingerprint has no matrix
products, which ``glsim.core.products`` makes equal everywhere.
"""

from __future__ import annotations

import hashlib
import socket
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from glsim.core.errors import ConfigError
from glsim.core.mesh import occluder_of
from glsim.data.worker_processes import run_tasks
from glsim.gl.context import borrowed_context, describe
from glsim.gl.draw import shader_arithmetic


@dataclass(frozen=True)
class Machine:
    """The host, OpenGL renderer and arithmetic ``fingerprint`` of a process."""

    host: str
    renderer: str
    arithmetic: str

    def refuse_other(self, first: Machine) -> None:
        """Raise ConfigError if renderer or arithmetic differ from the first machine's."""
        if (self.renderer, self.arithmetic) != (first.renderer, first.arithmetic):
            raise ConfigError(
                f"{self.host}: a worker computes differently from the process that started it "
                f"({self.renderer}, {self.arithmetic}, not {first.renderer}, {first.arithmetic}): "
                "give both the same OpenGL driver and NPY_DISABLE_CPU_FEATURES"
            )


def fingerprint(context: Any) -> str:
    """Hash the results of fixed computations on this machine, in NumPy and in a GL context."""
    results = _numpy_arithmetic() + shader_arithmetic(context)
    return hashlib.blake2b(results, digest_size=8).hexdigest()


def this_machine(context: Any) -> Machine:
    """Return the Machine of this process."""
    return Machine(socket.gethostname(), describe(context)["renderer"], fingerprint(context))


def machine_of_workers(environment: Mapping[str, str], backend: str | None) -> Machine:
    """Start a worker process and return its Machine. Raises the errors of the worker."""
    (machine,) = run_tasks(_MachineReport(backend), [None], 1, environment)
    return machine


@dataclass(frozen=True)
class _MachineReport:
    """The job of a worker process that reports its Machine."""

    backend: str | None

    def run(self, tasks: Iterator[None]) -> Iterator[Machine]:
        for _ in tasks:
            with borrowed_context(self.backend) as context:
                yield this_machine(context)

    def doing(self, _: None) -> str:
        return "computing what tells machines apart"


@lru_cache(maxsize=1)
def _numpy_arithmetic() -> bytes:
    """Return the results of fixed NumPy and occluder computations, as bytes."""
    parts: list[Any] = []
    for kind in (np.float32, np.float64):
        # The golden section spreads the fractional parts evenly over [0, 1).
        row: Any = ((np.arange(1, 4097) * 0.6180339887498949) % 1).astype(kind)
        points = row[:4095].reshape(-1, 3) - kind(0.5)
        parts += [np.exp(-row), np.log(row + 1), np.sin(9 * row), np.cos(9 * row), np.tan(row)]
        parts += [np.arctan2(row, row[::-1]), row ** kind(1.7), np.sqrt(row), np.tanh(row)]
        parts += [np.arcsin(row), np.arccos(row), np.hypot(row, 1)]
        parts += [np.linalg.norm(points, axis=1), np.einsum("ij,ij->i", points, points)]
        parts += [np.cumsum(row), row.sum(keepdims=True), points.mean(axis=0)]
    across, up = np.meshgrid(np.arange(24.0), np.arange(24.0))
    surface = np.stack([across, up, 3 * np.sin(across / 4) * np.cos(up / 5)], axis=-1)
    corner = (24 * np.arange(23)[:, None] + np.arange(23)).reshape(-1, 1)
    triangles = np.concatenate([corner + np.array([0, 1, 24]), corner + np.array([1, 25, 24])])
    parts.append(occluder_of(surface.reshape(-1, 3), triangles))
    return b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
