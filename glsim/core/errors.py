"""The exceptions that glsim raises on purpose: one line says what is wrong, where, and the cure."""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterable
from importlib.util import find_spec

#: Longest message, characters: a driver's log, cut to 2,000, with the file's name and advice.
_LONGEST = 2500
#: Control characters of ASCII and Latin 1.
_CONTROL = re.compile("[\x00-\x1f\x7f-\x9f]")


def printable(text: str) -> str:
    """Escape the control characters of a text, which could change the terminal."""
    return _CONTROL.sub(lambda match: ascii(match[0])[1:-1], text)


class GlsimError(Exception):
    """The base class of all errors of glsim.

    Its text is one line of bounded length, whatever a file or a name adds to the message: control
    characters are escaped, and a long message loses its middle.
    """

    def __str__(self) -> str:
        text = printable(super().__str__())
        if len(text) <= _LONGEST:
            return text
        return f"{text[: _LONGEST // 2]} ... {text[-_LONGEST // 2 + 5 :]}"


class ConfigError(GlsimError):
    """The error of a wrong setting, parameter or sensor file (CLI exit status 2)."""


class UnknownSettingError(ConfigError):
    """The error of an unknown setting ``name``; ``sensor``: the sensor of the settings, or ""."""

    def __init__(self, text: str, name: str, sensor: str = "") -> None:
        super().__init__(text)
        self.name, self.sensor = name, sensor


class DepthRangeError(ConfigError):
    """The error of a depth too large for a file's 16 bits in the chosen unit."""


class ShaderError(GlsimError):
    """The error of a GLSL file that does not parse, compile or link."""


class DeviceError(GlsimError):
    """The error of a machine without the requested OpenGL context or camera."""


class MeshError(GlsimError):
    """The error of a face that cannot be read or cannot be rendered."""


class DatasetError(GlsimError):
    """The error of a data set on disk that is invalid or cannot be written."""


class AccessError(DatasetError, DeviceError):
    """The error of a store that refuses this machine, for example one without credentials."""


class NoDepthError(DatasetError, ConfigError):
    """The error of an argument that names no depth maps (CLI exit status 2)."""


class MapSizeError(DatasetError, ConfigError):
    """The error of a depth map too small for the sensor; a batch goes on without this map."""


class TrainError(GlsimError):
    """The error of a training that cannot start, continue or be saved, or of a bad checkpoint."""


class DenoiserError(GlsimError):
    """The error of a denoiser that cannot be loaded or returns an invalid depth map."""


def one_line(error: BaseException) -> str:
    """Return the type and text of an exception in one line; the text of a plug-in's may fail."""
    try:
        return f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
    except KeyboardInterrupt:
        raise
    except BaseException:
        return "an exception whose text fails"


def counted(number: int, one: str, many: str = "") -> str:
    """Write a number with its noun, whose plural may be irregular: "1 frame", "2 people"."""
    return f"{number} {one if number == 1 else many or one + 's'}"


def with_mesh_option(text: str, before: str) -> str:
    """Turn unit=... and axes=... of an error message into options, by a prefix such as "--"."""
    return re.sub(r"(?<![\w.-])(unit|axes)='?([\w.+-]*\w)'?", rf"{before}\1=\2", text)


def did_you_mean(
    name: str, known: Iterable[str], table: str = "", elsewhere: Iterable[str] = ()
) -> str:
    """Suggest known names for an unknown one; without any that is similar, list them all.

    First come the names ``elsewhere`` that end in it after a dot, then similar ones, which get the
    prefix ``table``, then those that contain it: "d435" means "realsense-d435".
    """
    names = sorted(known)
    near = sorted(n for n in elsewhere if n.rpartition(".")[2] == name)[:3]
    within = [n for n in names if len(name) > 2 and name.lower() in n.lower()]
    near = near or [table + n for n in difflib.get_close_matches(name, names, n=3) or within[:3]]
    if near:
        return f"did you mean {' or '.join(map(repr, near))}?"
    return f"known: {', '.join(names)}" if names else "there are none"


def pip_install(extra: str) -> str:
    """Return the command that adds an extra to glsim, from where glsim itself was installed.

    With the advice to install PyTorch first where the extra brings it: its default wheel for Linux
    downloads gigabytes of CUDA.
    """
    from importlib.metadata import PackageNotFoundError, distribution  # slow to import
    from urllib.parse import urlsplit
    from urllib.request import url2pathname

    where, options = "glsim", ""
    try:  # PEP 610: pip writes down a folder or file that it installs from
        record = json.loads(distribution("glsim").read_text("direct_url.json") or "{}")
    except (PackageNotFoundError, ValueError):
        record = {}
    if (url := record.get("url", "")).startswith("file:"):
        where = url2pathname(urlsplit(url).path)
        options = "-e " * record.get("dir_info", {}).get("editable", False)
    command = f"pip install {options}'{where}[{extra}]'"
    if extra in ("train", "export", "laptop"):
        command += f" (without a GPU first: {_CPU_TORCH})"
    return command


_CPU_TORCH = "pip install torch --index-url https://download.pytorch.org/whl/cpu"


def require_package(name: str, what: str, extra: str) -> None:
    """Raise ConfigError if a package that ``what`` needs is not installed."""
    if find_spec(name) is None:
        raise ConfigError(f"{what} needs {name}, which is not installed: {pip_install(extra)}")
