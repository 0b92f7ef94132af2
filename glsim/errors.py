"""The errors that glsim raises on purpose.

    GlsimError
    |- ConfigError    a setting, a parameter or a sensor file is wrong (CLI exit status 2)
    |- ShaderError    a GLSL file does not parse, compile or link
    |- DeviceError    no OpenGL context of the requested kind is available
    |- MeshError      a face cannot be read or cannot be rendered
    |- DatasetError   a data set on disk is invalid, or cannot be written
    |- TrainError     a training cannot start, continue or be saved
    |- DenoiserError  a denoiser cannot be loaded, or returns an invalid depth map

Every message says in one line what is wrong, where, and how to fix it.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class GlsimError(Exception):
    """The base class: catch it to catch every error of glsim."""


class ConfigError(GlsimError):
    """A setting, a parameter or a sensor file is wrong."""


class ShaderError(GlsimError):
    """A GLSL file does not parse, compile or link."""


class DeviceError(GlsimError):
    """No OpenGL context of the requested kind is available."""


class MeshError(GlsimError):
    """A face cannot be read or cannot be rendered."""


class DatasetError(GlsimError):
    """A data set on disk is invalid, or cannot be written."""


class TrainError(GlsimError):
    """A training cannot start, continue or be saved, or a checkpoint is invalid."""


class DenoiserError(GlsimError):
    """A denoiser cannot be loaded, or returns an invalid depth map."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """Return the end of an "unknown name" message: similar names if any, otherwise all names."""
    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=3)
    if near:
        return f"did you mean {' or '.join(repr(n) for n in near)}?"
    return f"known: {', '.join(names)}" if names else "there are none"
