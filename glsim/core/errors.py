"""The errors that glsim raises on purpose.

    GlsimError
    |- ConfigError    a setting, a parameter or a sensor file is wrong (CLI exit status 2)
    |- ShaderError    a GLSL file does not parse, compile or link
    |- DeviceError    no OpenGL context of the requested kind, or no camera, is available
    |- MeshError      a face cannot be read or cannot be rendered
    |- DatasetError   a data set on disk is invalid, or cannot be written
    |- TrainError     a training cannot start, continue or be saved
    |- DenoiserError  a denoiser cannot be loaded, or returns an invalid depth map

Every message says in one line what is wrong, where, and how to fix it.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from importlib.util import find_spec

#: Longest message, characters: a driver's, cut to 2,000, with its file and advice.
_LONGEST = 2500
#: Control characters of ASCII and Latin 1.
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f]")


def printable(text: str) -> str:
    """Return a text with its control characters escaped: they could rewrite the terminal."""
    return _CONTROL.sub(lambda match: ascii(match[0])[1:-1], text)


class GlsimError(Exception):
    """The base class: catch it to catch every error of glsim.

    Its text is one line of bounded length, whatever a file or a name put into the message: control
    characters are escaped, and the middle of a long one is left
    out.
    """

    def __str__(self) -> str:
        text = printable(super().__str__())
        if len(text) <= _LONGEST:
            return text
        return f"{text[: _LONGEST // 2]} ... {text[-_LONGEST // 2 + 5 :]}"


class ConfigError(GlsimError):
    """A setting, a parameter or a sensor file is wrong."""


class DepthRangeError(ConfigError):
    """A depth is too large for the 16 bits of a file in the chosen unit."""


class ShaderError(GlsimError):
    """A GLSL file does not parse, compile or link."""


class DeviceError(GlsimError):
    """No OpenGL context of the requested kind, or no camera, is available."""


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


#: Advice where PyTorch is missing: its default wheel for Linux brings gigabytes of CUDA.
CPU_TORCH = (
    "without a GPU first: pip install torch --index-url https://download.pytorch.org/whl/cpu"
)


def training_needs_torch(error: ImportError) -> TrainError:
    """Return the error of a training on a machine without PyTorch."""
    return TrainError(
        "training needs PyTorch and Lightning Fabric: pip install 'glsim[train]' "
        f"({CPU_TORCH}) ({error})"
    )


def require_package(name: str, what: str, extra: str) -> None:
    """Raise ConfigError if a package that ``what`` needs is not installed, before long work."""
    if find_spec(name) is None:
        raise ConfigError(
            f"{what} needs {name}, which is not installed: pip install 'glsim[{extra}]'"
        )
