"""Test that contexts are used again, and that memory does not grow with their number."""

import os
import subprocess
import sys
import threading
from typing import Any

import numpy as np
import pytest
from moderngl import Context

from glsim.core.errors import DeviceError
from glsim.gl.context import borrowed_context, open_context
from glsim.settings.schema import Settings, load_settings
from glsim.simulation.depth_noise import DepthNoise
from glsim.simulation.frame import Frame
from glsim.simulation.pipeline import open_sources, simulate


def settings(sensor: str = "ideal") -> Settings:
    source = {"kind": "procedural", "subjects": 1, "frames_per_subject": 2}
    tree = {"sensor": sensor, "source": source, "output": {"crop": 48}}
    return load_settings(overrides=tree)


def test_one_thread_borrows_one_context_and_two_at_once_are_two() -> None:
    with borrowed_context() as first:
        pass
    with borrowed_context() as again, borrowed_context() as other:
        assert again is first
        assert other is not first
    seen = []

    def elsewhere() -> None:
        with borrowed_context() as context:
            seen.append(context)

    thread = threading.Thread(target=elsewhere)
    thread.start()
    thread.join()
    assert seen[0] is not first


def test_a_context_given_back_late_frees_nothing_of_the_one_in_use(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Python ends a generator that nobody finished at any time, e.g. while another one draws."""
    monkeypatch.setattr("glsim.gl.context._idle", {})
    late = borrowed_context()
    first = late.__enter__()
    number = first.texture((4, 4), 1).glo  # unused at once: to be freed when it is safe
    with borrowed_context() as other:
        texture = other.texture((4, 4), 1, bytes(16))
        assert texture.glo == number
        late.__exit__(None, None, None)
        framebuffer = other.framebuffer([texture])  # fails if the texture is gone
        assert framebuffer.read(components=1) == bytes(16)


def test_simulations_in_turn_use_one_context_and_leave_nothing_in_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each context that is opened costs 40 kB that are never freed."""
    opened = []

    def count(backend: str | None = None) -> Context:
        opened.append(open_context(backend))
        return opened[-1]

    monkeypatch.setattr("glsim.gl.context.open_context", count)
    monkeypatch.setattr("glsim.gl.context._idle", {})
    sources = open_sources(settings())
    for _ in range(5):
        assert len(list(simulate(settings(), sources=sources))) == 2
        with borrowed_context() as context:
            assert len(context.objects) == 0, "what the simulation before left is freed"
    assert len(opened) == 1


def test_frames_do_not_depend_on_who_used_the_context_before() -> None:
    def frames(sensor: str) -> list[np.ndarray]:
        return [f.noisy for f in simulate(settings(sensor)) if isinstance(f, Frame)]

    first = frames("kinect-v1")
    frames("kinect-v2-fast")
    unfinished: Any = simulate(settings("ideal"))
    next(unfinished)
    for before, after in zip(first, frames("kinect-v1"), strict=True):
        np.testing.assert_array_equal(before, after)
    unfinished.close()


def test_a_simulation_may_be_closed_by_another_thread() -> None:
    generators: list[Any] = []

    def begin() -> None:
        generators.append(simulate(settings()))
        next(generators[0])

    thread = threading.Thread(target=begin)
    thread.start()
    thread.join()
    generators[0].close()
    assert len(list(simulate(settings()))) == 2


@pytest.mark.parametrize("backend", ["egl", "osmesa"])
def test_backends_do_not_share(backend: str) -> None:
    with borrowed_context(backend) as context:
        name = str(context.info["GL_RENDERER"])
    assert "llvmpipe" in name or "softpipe" in name or backend == "egl"


#: Ends EGL as pyrender does, while a DepthNoise and an idle context are open.
_EGL_ENDS = """
import ctypes, numpy
from glsim import DepthNoise, load_settings, simulate
from glsim.core.errors import DeviceError
from glsim.gl.context import open_context
source = {"kind": "procedural", "subjects": 1}
settings = load_settings(overrides={"sensor": "ideal", "source": source, "output": {"crop": 64}})
before = [frame.noisy for frame in simulate(settings)]
camera = {"width": 8, "height": 8, "fx": 9.0, "fy": 9.0, "cx": 4.0, "cy": 4.0}
with DepthNoise.for_camera("ideal", **camera, first_pixel=0.5, backend="egl") as corrupt:
    corrupt(numpy.ones((8, 8)))  # its context opens with the first map
    egl = ctypes.CDLL("libEGL.so.1")
    egl.eglGetCurrentDisplay.restype = ctypes.c_void_p
    egl.eglTerminate(ctypes.c_void_p(egl.eglGetCurrentDisplay()))
    other = open_context("egl")
    try:
        corrupt(numpy.ones((8, 8)))
        raise SystemExit("drew in another's context")
    except DeviceError as error:
        assert "ended all OpenGL contexts" in str(error), error
after = [frame.noisy for frame in simulate(settings)]
assert all((a == b).all() for a, b in zip(before, after, strict=True))
"""


def test_contexts_that_another_library_ended_are_not_drawn_in() -> None:
    """GL would draw in whichever context is current, over its objects, without an error."""
    done = subprocess.run([sys.executable, "-c", _EGL_ENDS], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_context_of_another_thread_is_told_as_such() -> None:
    camera = {"width": 8, "height": 8, "fx": 9.0, "fy": 9.0, "cx": 4.0, "cy": 4.0}
    failed: list[BaseException | None] = []
    with DepthNoise.for_camera("ideal", **camera, first_pixel=0.5, backend="egl") as corrupt:
        corrupt(np.ones((8, 8)))

        def call() -> None:
            try:
                corrupt(np.ones((8, 8)))
            except DeviceError as error:
                failed.append(error)

        thread = threading.Thread(target=call)
        thread.start()
        thread.join()
        corrupt(np.ones((8, 8)))
    assert len(failed) == 1
    assert "belongs to the thread that opened it" in str(failed[0])


def test_the_renderer_is_the_expected_one(context: Context) -> None:
    """CI says which with GLSIM_EXPECT_RENDERER, so that a changed image is noticed."""
    expected = os.environ.get("GLSIM_EXPECT_RENDERER", "")
    assert expected.lower() in str(context.info["GL_RENDERER"]).lower()
