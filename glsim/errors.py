"""Everything glsim raises on purpose.

    GlsimError
    |- ConfigError    a setting, a parameter or a sensor file is wrong (CLI exit status 2)
    |- ShaderError    a GLSL file does not parse, compile or link
    |- DeviceError    no OpenGL context of the wanted kind
    |- MeshError      a face cannot be read or cannot be rendered
    |- DatasetError   a data set on disk is not what it should be, or cannot be written
    |- TrainError     a training cannot start, go on or be kept
    |- DenoiserError  a denoiser cannot be loaded, or returns what is no depth map

Every message says what is wrong, where, and what to do about it, in one line.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class GlsimError(Exception):
    """Root of the tree; catch this to catch all of them."""


class ConfigError(GlsimError):
    """A setting, a parameter or a sensor file is wrong."""


class ShaderError(GlsimError):
    """A GLSL file does not parse, compile or link."""


class DeviceError(GlsimError):
    """No OpenGL context of the wanted kind can be had."""


class MeshError(GlsimError):
    """A face cannot be read or cannot be rendered."""


class DatasetError(GlsimError):
    """A data set on disk is not what it should be, or cannot be written."""


class TrainError(GlsimError):
    """A training cannot start, go on or be kept; a checkpoint is not what it should be."""


class DenoiserError(GlsimError):
    """A denoiser cannot be loaded, or returns what is no depth map."""


def did_you_mean(name: str, known: Iterable[str]) -> str:
    """The tail of an "unknown name" message: near names if any, otherwise all of them."""
    names = sorted(known)
    near = difflib.get_close_matches(name, names, n=3)
    if near:
        return f"did you mean {' or '.join(repr(n) for n in near)}?"
    return f"known: {', '.join(names)}" if names else "there are none"
