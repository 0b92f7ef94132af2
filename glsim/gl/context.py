"""Open an OpenGL context without a display, through EGL or OSMesa."""

from __future__ import annotations

import ctypes
import ctypes.util
import logging
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any, Literal
from weakref import WeakKeyDictionary

import moderngl

from glsim.core.errors import DeviceError, did_you_mean

log = logging.getLogger(__name__)

Backend = Literal["egl", "osmesa"]
BACKENDS: tuple[Backend, ...] = ("egl", "osmesa")

#: Backend -> how to install its missing libraries (Debian and Ubuntu).
INSTALL_HINT = {
    "egl": "apt-get install libegl1 libgl1 libgl1-mesa-dri",
    "osmesa": "apt-get install libosmesa6",
}

_DEVICE_FUNCTIONS = (b"eglQueryDevicesEXT", b"eglQueryDeviceStringEXT")

#: The shaders need OpenGL 3.3 core; every Mesa since 2013 and every GPU driver has it.
GL_VERSION = (3, 3)


def chosen_backend(backend: str | None = None) -> Backend | None:
    """Return ``backend``, else GLSIM_BACKEND, else None for any. Raises DeviceError if unknown."""
    name = backend or os.environ.get("GLSIM_BACKEND") or None
    if name is not None and name not in BACKENDS:
        raise DeviceError(f"no such backend {name!r}: {did_you_mean(name, BACKENDS)}")
    return name


def open_context(backend: str | None = None) -> moderngl.Context:
    """Open a context and make it current on this thread; the caller releases it.

    Raises DeviceError with the reason for each backend that was tried.

    Args:
        backend: "egl", "osmesa", or None for GLSIM_BACKEND, or else the first that works. A
            forked process tries a backend first that its parent has not opened.
            GLSIM_EGL_DEVICE selects one of several GPUs by number (``glsim info`` lists them).
            Mesa's software rasteriser uses one thread unless LP_NUM_THREADS is set: one
            process per core is faster than several threads per frame.
    """
    os.environ.setdefault("LP_NUM_THREADS", "0")
    chosen = chosen_backend(backend)
    failures = []
    for name in [chosen] if chosen else sorted(BACKENDS, key=_opened_by_parent):
        try:
            loader: Any = None if name == "egl" else _OSMesa()
            context = moderngl.create_context(context=loader) if loader else _open_egl()
        except Exception as error:  # moderngl, glcontext and ctypes raise plain Exceptions
            failures.append(f"{name}: {error} ({INSTALL_HINT[name]})")
            continue
        if failures:
            log.warning("using %s, because %s", name, failures[0])
        context.gc_mode = "context_gc"  # "auto" would free objects in whichever context is current
        keep_freed_memory()
        _first_opened_by.setdefault(name, os.getpid())
        return context
    raise DeviceError("no OpenGL context: " + "; ".join(failures))


#: Backend -> ID of the process that opened it first; a forked process inherits the entries.
_first_opened_by: dict[Backend, int] = {}


def _opened_by_parent(backend: Backend) -> bool:
    """Return whether a parent process opened this backend before it forked this process.

    Mesa writes compiled shaders to its cache in a thread. A fork does not copy threads, so a forked
    process waits for ever when it compiles a shader that is not in the cache (Mesa 22.3).
    """
    return _first_opened_by.get(backend, os.getpid()) != os.getpid()


@contextmanager
def borrowed_context(backend: str | None = None) -> Iterator[moderngl.Context]:
    """Lend a context that is current on this thread, and keep it for the thread's next block.

    Mesa keeps 40 kB of each context for the life of the process: a loop over ``simulate`` with a
    new context each time would grow without end. The last borrower's objects are freed first.
    Arguments and errors are the same as in ``open_context``.
    """
    place = (
        os.getpid(),  # a context does not work in a forked child
        threading.get_ident(),
        chosen_backend(backend),
        os.environ.get("GLSIM_EGL_DEVICE", ""),
    )
    context = _idle.pop(place, None)
    if context is None or not _enter(context):
        context = open_context(backend)
    make_current(context)
    try:
        yield context
    finally:
        if place in _idle or threading.get_ident() != place[1] or os.getpid() != place[0]:
            context.release()
        else:
            # The context's objects are not freed here. An unfinished generator ends whenever Python
            # deletes it; another context may then be current, whose objects have the same numbers.
            _idle[place] = context


#: One unused context per process, thread, backend and device.
_idle: dict[tuple[int, int, Backend | None, str], moderngl.Context] = {}


def make_current(context: moderngl.Context) -> None:
    """Make ``context`` current on this thread, and free its unused objects.

    A process may hold several contexts; GL calls go to the current one, and no error reports a
    wrong one. A call takes 1 us if the context is already current. Raises DeviceError if another
    thread has opened the context, or another library has ended it.
    """
    if not _enter(context):
        if _threads.get(context) != threading.get_ident():
            raise DeviceError(
                "an OpenGL context belongs to the thread that opened it, and this is another: make "
                "a Simulator or DepthNoise in each thread, or call it in its own"
            )
        raise DeviceError(
            "another library of this process has ended all OpenGL contexts (pyrender does, when "
            "its OffscreenRenderer is deleted): keep its renderer until glsim is done, run it in "
            "a process of its own, or choose the backend osmesa for one of the two"
        )
    context.gc()


#: Context opened by glsim -> its EGL handle, 0 after the display was ended, and its thread.
_handles: WeakKeyDictionary[moderngl.Context, int] = WeakKeyDictionary()
_threads: WeakKeyDictionary[moderngl.Context, int] = WeakKeyDictionary()


def _enter(context: moderngl.Context) -> bool:
    """Make a context current; return False if the context no longer exists.

    eglTerminate ends all contexts of a display, and each device has one display, which other
    libraries share. moderngl does not report a failed switch.
    """
    context.__enter__()  # type: ignore[no-untyped-call]
    handle = _handles.get(context)
    return handle is None or handle == _current_egl_context()


def _current_egl_context() -> int:
    """Return the EGL handle of this thread's current context; 0 without a context."""
    return _egl().eglGetCurrentContext() or 0


@cache
def _egl() -> Any:
    egl = ctypes.CDLL(ctypes.util.find_library("EGL") or "libEGL.so.1")
    egl.eglGetCurrentContext.restype = ctypes.c_void_p
    return egl


def _open_egl() -> moderngl.Context:
    device = os.environ.get("GLSIM_EGL_DEVICE", "")
    if device and not device.isdigit():
        raise DeviceError(f"GLSIM_EGL_DEVICE={device}: give a number")
    options: dict[str, Any] = {
        "backend": "egl",
        "require": GL_VERSION[0] * 100 + GL_VERSION[1] * 10,
    }
    if device:
        options["device_index"] = int(device)
    context: moderngl.Context = moderngl.create_context(standalone=True, **options)
    handle = _current_egl_context()
    for other, taken in list(_handles.items()):
        if taken == handle:  # the address is used again: the old context no longer exists
            _handles[other] = 0
    _handles[context] = handle
    _threads[context] = threading.get_ident()
    return context


class _OSMesa:
    """A loader of OSMesa for moderngl; its constants are from GL/osmesa.h and GL/gl.h."""

    _FORMAT, _DEPTH_BITS, _PROFILE, _CORE_PROFILE = 0x22, 0x30, 0x33, 0x34
    _MAJOR, _MINOR = 0x36, 0x37
    _RGBA, _UNSIGNED_BYTE = 0x1908, 0x1401

    def __init__(self) -> None:
        name = ctypes.util.find_library("OSMesa") or "libOSMesa.so.8"
        self._lib = ctypes.CDLL(name)
        self._lib.OSMesaCreateContextAttribs.restype = ctypes.c_void_p
        self._lib.OSMesaCreateContextAttribs.argtypes = [ctypes.c_void_p, ctypes.c_void_p]
        self._lib.OSMesaMakeCurrent.argtypes = [ctypes.c_void_p] * 2 + [ctypes.c_int] * 3
        self._lib.OSMesaGetProcAddress.restype = ctypes.c_void_p
        self._lib.OSMesaGetProcAddress.argtypes = [ctypes.c_char_p]
        self._lib.OSMesaDestroyContext.argtypes = [ctypes.c_void_p]
        attributes = [
            self._FORMAT, self._RGBA, self._DEPTH_BITS, 24, self._PROFILE, self._CORE_PROFILE,
            self._MAJOR, GL_VERSION[0], self._MINOR, GL_VERSION[1], 0,
        ]  # fmt: skip
        array = (ctypes.c_int * len(attributes))(*attributes)
        self._context = self._lib.OSMesaCreateContextAttribs(array, None)
        if not self._context:
            raise DeviceError(f"{name} has no OpenGL {GL_VERSION[0]}.{GL_VERSION[1]} core profile")
        # A default framebuffer must exist; frames are drawn into textures instead.
        self._pixels = (ctypes.c_ubyte * (4 * 4 * 4))()
        self.__enter__()

    def load_opengl_function(self, name: str) -> int:
        return self._lib.OSMesaGetProcAddress(name.encode()) or 0

    def __enter__(self) -> None:
        if not self._lib.OSMesaMakeCurrent(self._context, self._pixels, self._UNSIGNED_BYTE, 4, 4):
            raise DeviceError("OSMesaMakeCurrent failed")

    def __exit__(self, *_: object) -> None: ...

    def release(self) -> None:
        self._lib.OSMesaDestroyContext(self._context)


def describe(context: moderngl.Context) -> dict[str, str]:
    """Return the driver's vendor, renderer and version, for ``glsim info`` and data set headers."""
    names = ("vendor", "renderer", "version")
    return {name: str(context.info[f"GL_{name.upper()}"]) for name in names}


def egl_devices() -> list[str]:
    """List the EGL devices of this machine, in the order of GLSIM_EGL_DEVICE; [] without EGL.

    Uses EGL_EXT_device_enumeration and EGL_EXT_device_query; EGL_EXTENSIONS is from egl.h.
    """
    extensions_name, limit = 0x3055, 16
    try:
        egl = _egl()
        egl.eglGetProcAddress.restype = ctypes.c_void_p
        addresses = [egl.eglGetProcAddress(name) for name in _DEVICE_FUNCTIONS]
    except (OSError, AttributeError):
        return []
    if not all(addresses):
        return []
    query = ctypes.CFUNCTYPE(
        ctypes.c_uint, ctypes.c_int, ctypes.POINTER(ctypes.c_void_p), ctypes.POINTER(ctypes.c_int)
    )(addresses[0])
    describe_device = ctypes.CFUNCTYPE(ctypes.c_char_p, ctypes.c_void_p, ctypes.c_int)(addresses[1])
    devices, count = (ctypes.c_void_p * limit)(), ctypes.c_int()
    if not query(limit, devices, ctypes.byref(count)):
        return []
    texts = [describe_device(devices[n], extensions_name) for n in range(count.value)]
    return [(text or b"").decode() or "no extensions" for text in texts]


def is_software(context: moderngl.Context) -> bool:
    """Return whether the CPU, not a GPU, draws the frames."""
    return any(word in str(context.info["GL_RENDERER"]) for word in ("llvmpipe", "softpipe"))


def keep_freed_memory() -> None:
    """Make glibc keep the memory that llvmpipe frees after each frame.

    llvmpipe allocates megabytes of bins per draw call. Returning them to the kernel each time
    costs 7 to 12 % of a frame in page faults (perf, Mesa 22.3). Constants M_* are from malloc.h.
    """
    trim_threshold, mmap_threshold, half_gigabyte = -1, -3, 1 << 29
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except AttributeError:  # another libc: nothing to tune
        return
    mallopt(trim_threshold, half_gigabyte)
    mallopt(mmap_threshold, half_gigabyte)
