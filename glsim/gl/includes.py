"""Resolve the includes of a GLSL file; each line keeps its origin."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import NamedTuple

from glsim import shaders
from glsim.core import reason
from glsim.core.errors import ShaderError
from glsim.core.files.regular import read_regular

#: The folder of the shipped shaders. An include is searched beside its file, then here.
SHADER_ROOT = Path(shaders.__path__[0]).resolve()

#: Name of an include that Python generates -> the function that returns its text.
GENERATED = {"reason.glsl": reason.glsl}

INCLUDE = re.compile(r'^\s*#include\s+["<](?P<name>[^">]+)[">]\s*$')
#: Largest GLSL file, bytes; the longest shipped one has 9,000.
_MAX_BYTES = 1 << 20


class Line(NamedTuple):
    """A line of GLSL after includes are resolved, with its original file and line number."""

    text: str
    file: str
    number: int

    @property
    def where(self) -> str:
        """The origin of the line, "file:number", for messages."""
        return f"{self.file}:{self.number}"


def read_shader(file: Path) -> str:
    """Read a GLSL file. Raises ShaderError."""
    try:
        return read_regular(file, _MAX_BYTES).decode("utf-8-sig")
    except FileNotFoundError:
        raise ShaderError(f"{file}: no such file") from None
    except OSError as error:
        raise ShaderError(f"{file}: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise ShaderError(f"{file}: {error}") from None


def flatten(text: str, file: Path) -> list[Line]:
    """Replace each include by the lines of its file; a repeated include is dropped.

    Raises ShaderError: the text is too long, or an include cannot be read.

    ``text``: GLSL, which need not be on disk.
    """
    if len(text) > _MAX_BYTES:
        raise ShaderError(f"{file}: more than {_MAX_BYTES} characters")
    flat: list[Line] = []
    _append(file, text, flat, included=[], top=True)
    return flat


def _append(file: Path, text: str, flat: list[Line], included: list[Path], *, top: bool) -> None:
    """Append the lines of ``text``, and of the files that it includes, to ``flat``."""
    name = display_name(file)
    for number, line in enumerate(text.splitlines(), start=1):
        match = INCLUDE.match(line)
        if match is None:
            if top or not line.startswith("#version"):
                flat.append(Line(line, name, number))
            continue
        wanted = match["name"]
        if wanted in GENERATED:
            target, content = Path(wanted), GENERATED[wanted]()
        else:
            candidates = [file.parent / wanted, SHADER_ROOT / wanted]
            # ``isfile`` is False, without an error, for a name that no file can have.
            found = next((c for c in candidates if os.path.isfile(c)), None)  # noqa: PTH113
            if found is None:
                raise ShaderError(
                    f'{name}:{number}: #include "{wanted}": not beside the file nor in '
                    f"{SHADER_ROOT}"
                )
            target, content = found.resolve(), read_shader(found)
        if target not in included:
            included.append(target)
            _append(target, content, flat, included, top=False)


def display_name(file: Path) -> str:
    """Return a shipped shader's path below shaders/; any other path unchanged."""
    try:
        return str(file.resolve().relative_to(SHADER_ROOT))
    except ValueError:
        return str(file)
