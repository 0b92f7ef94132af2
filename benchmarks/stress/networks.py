"""Damaged networks and shaders: what other programs' compilers and runtimes read."""

from __future__ import annotations

import os
import resource
import select
import signal
from collections.abc import Callable
from pathlib import Path
from typing import Final, Literal

import numpy as np

from glsim.errors import GlsimError

#: Longest time of a driver with one shader, s, and its largest memory, bytes.
_SECONDS: Final = 20
_BYTES: Final = 6_000_000_000
#: The start of what ``in_child`` returns for a process that was ended by a signal.
CRASH: Final = "crash"

SHADER: Final = """#version 330 core
uniform sampler2D u_depth;
uniform float sigma_mm = 1.5; //@ [0, 20] mm standard deviation
uniform int steps = 3; //@ [1, 8] 1 how many
uniform uint u_seed;
out float depth; //@
float wave(float d, int i) { return 0.0001 * sigma_mm * sin(float(i) + d); }
void main() {
    ivec2 at = ivec2(gl_FragCoord.xy);
    float d = texelFetch(u_depth, at, 0).r;
    for (int i = 0; i < steps; ++i) d += wave(d, i);
    if (d > 0.5 && (u_seed & 1u) == 0u) d *= 1.001;
    depth = d;
}
"""
_SENSOR: Final = """
title = "mine"
[rig]
width = 64
height = 48
focal_px = [60.0, 60.0]
centre_px = [32.0, 24.0]
[[stage]]
use = "mine.glsl"
"""


def onnx_bytes(folder: Path) -> bytes:
    """Return a small network as ``glsim export`` writes it."""
    from glsim.denoise import checkpoint
    from glsim.train.models.registry import build_model
    from glsim.train.onnx_export import export_onnx

    model = {"kind": "paper_input", "backbone": {"kind": "dncnn", "depth": 3, "width": 4}}
    content = {"recipe": {"model": model}, "model": build_model(model).state_dict()}
    empty: dict[str, object] = {"data": {}, "progress": {}, "validation": {}}
    checkpoint.save(folder / "best.pt", {**content, **empty})
    export_onnx(folder / "best.pt", folder / "net.onnx")
    return (folder / "net.onnx").read_bytes()


def run_onnx(path: Path, runtime: Literal["onnxruntime", "opencv"]) -> None:
    """Load an ONNX file and denoise a small frame."""
    from glsim.denoise.onnx_file import load_onnx

    frame = 900 + np.random.default_rng(0).normal(0, 2, (48, 64)).astype(np.float32)
    load_onnx(path, runtime=runtime)(frame, frame > 0)


def draw(shader: Path) -> None:
    """Compile a stage by the driver and draw a small map with it."""
    from glsim.corrupt import Corrupter
    from glsim.settings.schema import load_settings

    sensor = shader.with_name("mine.toml")
    sensor.write_text(_SENSOR)
    settings = load_settings(overrides={"sensor": str(sensor)})
    with Corrupter(settings, (48, 64)) as corrupter:
        corrupter.corrupt(np.full((48, 64), 900, np.uint16))


def in_child(read: Callable[[], None]) -> str | None:
    """Run a function in a process of its own; return its error, None if there is none.

    Raises GlsimError for one of glsim's, TimeoutError after 20 s, RuntimeError for any other. A
    process that is ended by a signal returns CRASH and the signal.
    """
    reading, writing = os.pipe()
    pid = os.fork()
    if not pid:
        _child(read, writing)
    os.close(writing)
    handle = os.pidfd_open(pid)
    ended = bool(select.select([handle], [], [], 10 * _SECONDS)[0])  # others may need the processor
    if not ended:
        os.kill(pid, signal.SIGKILL)
    os.close(handle)
    with os.fdopen(reading, "rb") as pipe:
        text = pipe.read().decode(errors="replace")
    status = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    if not ended or status == -signal.SIGXCPU:
        raise TimeoutError(f"more than {_SECONDS} s")
    if status < 0:
        return f"{CRASH}: signal {-status}"
    if status == 1:
        raise GlsimError(text)
    if status:
        raise RuntimeError(text)
    return None


def _child(read: Callable[[], None], writing: int) -> None:
    status = 0
    try:
        resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS + 1))
        resource.setrlimit(resource.RLIMIT_AS, (_BYTES, _BYTES))
        quiet = os.open(os.devnull, os.O_WRONLY)
        os.dup2(quiet, 1)
        os.dup2(quiet, 2)
        read()
    except BaseException as error:
        status = 1 if isinstance(error, GlsimError) else 2
        name = "" if status == 1 else f"{type(error).__name__}: "
        os.write(writing, f"{name}{error}".encode(errors="replace")[:60_000])
    os._exit(status)
