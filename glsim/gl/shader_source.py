"""Read GLSL files, resolve their includes, and parse the interface that they declare.

It needs no GL context, so that stages can be listed and settings checked without one.
``glsim.gl.declarations`` has the syntax of declarations. A line ``//@ sparse`` declares that empty
pixels stay blank: where no surface is within a pixel and all layers that the stage reads are blank,
it writes 0 (in the layer ``reason``: NO_SURFACE). The stage need not be drawn there. Code for the
layer ``expected``, with its declarations, is between ``#ifdef EXPECTED`` and ``#endif``; it is
compiled only if this layer is requested.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from glsim.core.errors import ShaderError
from glsim.gl.declarations import (
    OUT,
    SPARSE,
    Layer,
    Parameter,
    declared_parameter,
    match_declaration,
    written_layer,
)
from glsim.gl.includes import GENERATED, SHADER_ROOT, flatten, read_shader

_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
#: Longest message of a driver: number of lines, and number of characters.
_MAX_MESSAGE_LINES, _MAX_MESSAGE = 20, 2000


@dataclass(frozen=True)
class ShaderSource:
    """A GLSL file with its includes resolved, and its declarations.

    Attributes:
        lines: the origin of each line of ``text``: (file, line number from 1).
        reads, writes: layers, in the order of their declaration.
        bound: names of the ``u_`` uniforms that glsim sets.
        sparse: whether the stage keeps empty pixels blank (``//@ sparse``).
    """

    file: Path
    text: str
    lines: tuple[tuple[str, int], ...]
    title: str
    parameters: Mapping[str, Parameter] = field(default_factory=dict)
    reads: tuple[str, ...] = ()
    writes: tuple[Layer, ...] = ()
    bound: tuple[str, ...] = ()
    sparse: bool = False

    @property
    def files(self) -> frozenset[Path]:
        """The files on disk that the text consists of, with all includes."""
        names = {name for name, _ in self.lines} - GENERATED.keys()
        return frozenset(SHADER_ROOT / name for name in names)

    def locate(self, message: str) -> str:
        """Replace the line numbers in a driver's message by file:line.

        Mesa writes ``0:12(3): error``, NVIDIA ``0(12) : error``. A wrong include causes hundreds.
        """

        def with_place(match: re.Match[str]) -> str:
            number = int(match.group("mesa") or match.group("nvidia"))
            if not 1 <= number <= len(self.lines):
                return match.group(0)
            file, line = self.lines[number - 1]
            return f"{file}:{line}:"

        pattern = r"\b0(?::(?P<mesa>\d+)\(\d+\)\s*:?|\((?P<nvidia>\d+)\)\s*:)"
        wanted = [line for line in message.splitlines() if re.search(pattern, line)]
        lines = [re.sub(pattern, with_place, line) for line in wanted[:_MAX_MESSAGE_LINES]]
        text = "; ".join(lines) or " ".join(message.split())
        left = len(wanted) - _MAX_MESSAGE_LINES
        more = f"; and {left} more lines" if left > 0 else ""
        return (text if len(text) <= _MAX_MESSAGE else f"{text[:_MAX_MESSAGE]}...") + more

    def uses(self, constant: str) -> bool:
        """Return whether the code, without its comments, contains a name."""
        return re.search(rf"\b{constant}\b", _COMMENT.sub("", self.text)) is not None

    def without(self, layer: str) -> ShaderSource:
        """Return the source without a layer, which the preprocessor removes from the code."""
        return replace(
            self,
            reads=tuple(name for name in self.reads if name != layer),
            writes=tuple(written for written in self.writes if written.name != layer),
        )

    def with_defines(self, **constants: int) -> ShaderSource:
        """Return the source with ``#define NAME VALUE`` lines inserted after its line #version.

        Raises ShaderError for a name that the code, without its comments, does not contain.
        """
        for name in constants:
            if not self.uses(name):
                raise ShaderError(f"{self.file}: the constant {name} is defined but not used")
        first, *rest = self.text.splitlines()
        defines = [f"#define {name} {value}" for name, value in constants.items()]
        origins = self.lines[:1] * len(defines)
        return replace(
            self,
            text="\n".join([first, *defines, *rest]) + "\n",
            lines=(*self.lines[:1], *origins, *self.lines[1:]),
        )


def load_source(file: Path) -> ShaderSource:
    """Read and parse a GLSL file. Raises ShaderError with file and line."""
    return parse_source(read_shader(file), file)


def parse_source(text: str, file: Path) -> ShaderSource:
    """Parse a GLSL text. Raises ShaderError with file and line."""
    flat = flatten(text, file)
    parameters: dict[str, Parameter] = {}
    reads, writes, bound = [], [], []
    for line in flat:
        match = match_declaration(line, vertex=file.suffix == ".vert")
        if match is None:
            continue
        name = match["name"]
        if match.re is OUT:
            writes.append(written_layer(match, line.where))
        elif not name.startswith("u_"):
            parameters[name] = declared_parameter(match, line)
        elif match["type"] == "sampler2D":
            reads.append(name[2:])
        else:
            bound.append(name)
    title = next((line.text[2:].strip() for line in flat if line.text.startswith("//")), file.stem)
    return ShaderSource(
        file,
        "\n".join(line.text for line in flat) + "\n",
        tuple((line.file, line.number) for line in flat),
        title,
        parameters,
        tuple(reads),
        tuple(writes),
        tuple(bound),
        any(SPARSE.match(line.text) for line in flat),
    )
