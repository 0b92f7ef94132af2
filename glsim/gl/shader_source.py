"""Read GLSL files: flatten includes, map lines back to files, parse the declared interface.

This needs no GL context, so that stages can be listed and settings checked without one.

    uniform float base_sigma_mm = 1.5;  //@ [0, 20] mm  standard deviation at 1 m

declares a parameter: type, name and default in GLSL, then range, unit ("1" for none) and help.
A second part in the brackets is for sliders alone: ``//@ [0, 65535; 0, 2000] counts ...`` shows 0
to 2000, ``//@ [0.1, 1e6; log] 1 ...`` a logarithmic scale, ``[0.1, 1e6; 1, 100 log]`` both. Values
outside it are valid in boxes and files.
``uniform sampler2D u_depth;`` declares that the layer ``depth`` is read and ``out float depth;``
that it is written; ``//@ 1/3`` after an ``out`` makes the written layers a third of the frame's
size. A line ``//@ sparse`` declares that a stage writes 0 (in the layer ``reason``: NO_SURFACE)
where no surface is within a pixel and all the layers that it reads are blank too, so that it need
not be drawn there. What a stage does for the layer ``expected`` stands between ``#ifdef EXPECTED``
and ``#endif``, its declarations too: it is compiled only where that layer is wanted. glsim binds
the other ``u_`` uniforms, a fixed set (glsim.noise.chain).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from math import ceil, floor, isfinite
from pathlib import Path

from glsim import reason, shaders
from glsim.errors import ShaderError
from glsim.files.regular import read_regular
from glsim.geometry.rect import Rect

#: The folder of the shipped shaders. Includes are searched beside the file, then here.
SHADER_ROOT = Path(shaders.__path__[0]).resolve()

#: Includes that Python generates, so that each fact has one place.
_GENERATED = {"reason.glsl": reason.glsl}

_INCLUDE = re.compile(r'^\s*#include\s+["<](?P<name>[^">]+)[">]\s*$')
_UNIFORM = re.compile(
    r"^\s*uniform\s+(?P<type>\w+)\s+(?P<name>\w+)\s*(?:\[\s*\w+\s*\])?"
    r"\s*(?:=\s*(?P<default>[^;]+?))?\s*;\s*(?://@(?P<note>.*)|//.*|/\*.*)?$"
)
_OUT = re.compile(
    r"^\s*(?:layout\s*\([^)]*\)\s*)?out\s+(?P<type>\w+)\s+(?P<name>\w+)\s*;"
    r"(?P<rest>\s*(?:/[/*].*)?)$"
)
#: Lines that start like a declaration but match none of the above: several names, a block, ...
_UNREADABLE = re.compile(r"^\s*(?:layout\s*\([^)]*\)\s*)?(?:uniform\s|out\s+\w+\s+[^;()]*;)")
_DECLARATION = re.compile(r"^\s*(?:layout|uniform|out)\b")
_NOTE = re.compile(
    r"^\s*(?:\[(?P<low>[^,;\]]+),(?P<high>[^,;\]]+)(?:;(?P<slider>[^\]]*))?\])?"
    r"\s*(?P<unit>[^\s\[]\S*)\s+(?P<help>\S.*)$"
)
#: The part of a note that is for sliders: two numbers, "log", or both.
_SLIDER = re.compile(r"^\s*(?:(?P<low>[^,\s]+)\s*,\s*(?P<high>[^,\s]+?))?\s*(?P<log>\blog)?\s*$")
_SCALE = re.compile(r"//@\s*(?P<scale>\d+(?:/\d+)?)\b")
_SPARSE = re.compile(r"^//@ sparse\b")
_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.DOTALL)
#: Largest GLSL file, bytes, and longest line with a declaration; the longest shipped have 9,000 and
#: 100. The patterns above take quadratic time in a line.
_MAX_BYTES = 1 << 20
_MAX_DECLARATION = 2000
#: What is kept of a driver's message: lines, and characters in all.
_MAX_MESSAGE_LINES, _MAX_MESSAGE = 20, 2000
#: Largest size of a written layer over the frame's: the renderer's finest has 5 samples a pixel.
_MAX_SCALE = 5
_PARAMETER_TYPES = {"float": float, "int": int, "bool": bool}
_LAYER_TYPES = {"float": 1, "vec2": 2, "vec4": 4}


@dataclass(frozen=True)
class Parameter:
    """A stage's parameter as declared. Values of all types are floats (bool: 0 or 1).

    Attributes:
        slider: the range that sliders show, if it is smaller than [low, high].
        log_scale: whether their scale is logarithmic.
    """

    name: str
    type: str
    default: float
    low: float
    high: float
    unit: str
    help: str
    file: Path
    line: int
    slider: tuple[float, float] | None = None
    log_scale: bool = False

    def problem(self, value: float) -> str | None:
        """Return why ``value`` is invalid, or None."""
        if not isfinite(value):
            return f"{value} is not a finite number"
        if self.type != "float" and value != int(value):
            return f"{value} is not a whole number"
        if not self.low <= value <= self.high:
            unit = "" if self.unit == "1" else f" {self.unit}"
            return f"{value:g} is outside [{self.low:g}, {self.high:g}]{unit}"
        return None


@dataclass(frozen=True)
class Layer:
    """An image that a shader writes.

    Attributes:
        scale: its size over the frame's size.
    """

    name: str
    type: str
    scale: Fraction = Fraction(1)

    @property
    def components(self) -> int:
        """Numbers per pixel."""
        return _LAYER_TYPES[self.type]

    def window(self, frame_window: Rect) -> Rect:
        """Convert a window from frame pixels to the pixels of this layer."""
        if self.scale == 1:
            return frame_window
        left, top, width, height = frame_window
        columns = floor(left * self.scale), ceil((left + width) * self.scale)
        rows = floor(top * self.scale), ceil((top + height) * self.scale)
        return Rect(columns[0], rows[0], columns[1] - columns[0], rows[1] - rows[0])


@dataclass(frozen=True)
class ShaderSource:
    """A GLSL file with its includes flattened, and its declarations.

    Attributes:
        lines: the origin of each line of ``text``, (file, 1-based line).
        reads, writes: layers, in the order of their declaration.
        bound: the names of the ``u_`` uniforms that glsim sets.
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
        """The files on disk that the text came from, includes among them."""
        names = {name for name, _ in self.lines} - _GENERATED.keys()
        return frozenset(SHADER_ROOT / name for name in names)

    def locate(self, message: str) -> str:
        """Replace the line numbers in a driver's message by file:line.

        Mesa writes ``0:12(3): error``, NVIDIA ``0(12) : error``. Only the first lines are kept: one
        wrong include makes hundreds.
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
        """Leave out a layer, read or written, whose code the preprocessor removes."""
        return replace(
            self,
            reads=tuple(name for name in self.reads if name != layer),
            writes=tuple(written for written in self.writes if written.name != layer),
        )

    def with_defines(self, **constants: int) -> ShaderSource:
        """Insert ``#define NAME VALUE`` lines after the first line, which is #version.

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
    return parse_source(_read(file), file)


def parse_source(text: str, file: Path) -> ShaderSource:
    """Parse GLSL that need not be on disk. Raises ShaderError with file and line.

    Args:
        file: named in messages; includes are searched beside it.
    """
    if len(text) > _MAX_BYTES:
        raise ShaderError(f"{file}: more than {_MAX_BYTES} characters")
    flat: list[tuple[str, str, int]] = []
    _flatten(file, text, flat, included=[], top=True)
    parameters: dict[str, Parameter] = {}
    reads, writes, bound = [], [], []
    for text, name, line in flat:
        where = f"{name}:{line}"
        if len(text) > _MAX_DECLARATION:
            if _DECLARATION.match(text):
                raise ShaderError(
                    f"{where}: a declaration of {len(text)} characters, the limit is "
                    f"{_MAX_DECLARATION}"
                )
            continue
        if match := _UNIFORM.match(text):
            kind, uniform = match["type"], match["name"]
            if kind == "sampler2D" and uniform.startswith("u_"):
                reads.append(uniform[2:])
            elif uniform.startswith("u_"):
                bound.append(uniform)
            else:
                parameters[uniform] = _parameter(match, name, line)
        elif file.suffix != ".vert" and (match := _OUT.match(text)):
            if match["type"] not in _LAYER_TYPES:
                raise ShaderError(
                    f"{where}: a written layer is {', '.join(_LAYER_TYPES)}, not {match['type']}"
                )
            writes.append(Layer(match["name"], match["type"], _scale(match["rest"], where)))
        elif _UNREADABLE.match(text) and not (file.suffix == ".vert" and _OUT.match(text)):
            raise ShaderError(
                f"{where}: declare one uniform or layer a line, as 'uniform TYPE NAME' or "
                f"'out TYPE NAME', not {text.strip()!r}"
            )
    title = next((t[2:].strip() for t, _, _ in flat if t.startswith("//")), file.stem)
    return ShaderSource(
        file,
        "\n".join(text for text, _, _ in flat) + "\n",
        tuple((name, line) for _, name, line in flat),
        title,
        parameters,
        tuple(reads),
        tuple(writes),
        tuple(bound),
        any(_SPARSE.match(text) for text, _, _ in flat),
    )


def declaration_patterns() -> dict[str, str]:
    """Return the regular expressions of declarations, in JavaScript's syntax, by name.

    A page in a browser reads edited stages with them; includes are those of ``load_source``.
    """
    patterns = {
        "include": _INCLUDE,
        "uniform": _UNIFORM,
        "out": _OUT,
        "unreadable": _UNREADABLE,
        "note": _NOTE,
        "slider": _SLIDER,
        "scale": _SCALE,
        "sparse": _SPARSE,
    }
    return {name: made.pattern.replace("(?P<", "(?<") for name, made in patterns.items()}


def included_text(name: str) -> str:
    """Return the text of a file that ``ShaderSource.lines`` names. Raises ShaderError."""
    if name in _GENERATED:
        return _GENERATED[name]()
    return _read(SHADER_ROOT / name)


def _read(file: Path) -> str:
    try:
        return read_regular(file, _MAX_BYTES).decode()
    except FileNotFoundError:
        raise ShaderError(f"{file}: no such file") from None
    except OSError as error:
        raise ShaderError(f"{file}: {error.strerror or error}") from None
    except UnicodeDecodeError as error:
        raise ShaderError(f"{file}: {error}") from None


def _scale(rest: str, where: str) -> Fraction:
    """Read the note ``//@ 1/3`` behind an ``out``; 1 without one. Raises ShaderError."""
    match = _SCALE.search(rest)
    if match is None:
        return Fraction(1)
    try:
        scale = Fraction(match["scale"])
    except (ZeroDivisionError, ValueError):
        scale = Fraction(0)
    if not Fraction(1, _MAX_SCALE) <= scale <= _MAX_SCALE:
        raise ShaderError(
            f"{where}: the size of a layer is 1/{_MAX_SCALE} to {_MAX_SCALE} times the frame's, "
            f"not {match['scale']:.40}"
        )
    return scale


def _flatten(
    file: Path, text: str, flat: list[tuple[str, str, int]], included: list[Path], *, top: bool
) -> None:
    """Append the lines of ``text``; include each file once (no include guards are needed)."""
    name = display_name(file)
    for number, line in enumerate(text.splitlines(), start=1):
        match = _INCLUDE.match(line)
        if match is None:
            if top or not line.startswith("#version"):
                flat.append((line, name, number))
            continue
        wanted = match["name"]
        if wanted in _GENERATED:
            target, content = Path(wanted), _GENERATED[wanted]()
        else:
            candidates = [file.parent / wanted, SHADER_ROOT / wanted]
            found = next((c for c in candidates if c.is_file()), None)
            if found is None:
                raise ShaderError(
                    f'{name}:{number}: #include "{wanted}": not beside the file nor in '
                    f"{SHADER_ROOT}"
                )
            target, content = found.resolve(), _read(found)
        if target not in included:
            included.append(target)
            _flatten(target, content, flat, included, top=False)


def display_name(file: Path) -> str:
    """Return a shipped shader's path below shaders/, or any other path unchanged."""
    try:
        return str(file.resolve().relative_to(SHADER_ROOT))
    except ValueError:
        return str(file)


def _parameter(match: re.Match[str], file: str, line: int) -> Parameter:
    where, name, kind = f"{file}:{line}", match["name"], match["type"]
    if kind not in _PARAMETER_TYPES:
        raise ShaderError(f"{where}: parameter {name!r} must be float, int or bool, not {kind}")
    note = _NOTE.match(match["note"] or "")
    if match["default"] is None or note is None:
        raise ShaderError(
            f"{where}: uniform {name!r} needs a default and a note, "
            f"e.g. uniform {kind} {name} = 1; //@ [0, 10] mm what it does "
            "(uniforms that glsim binds are called u_...)"
        )
    try:
        default = _number(match["default"])
        low = _number(note["low"]) if note["low"] else 0.0
        high = _number(note["high"]) if note["high"] else 1.0
    except ValueError as error:
        raise ShaderError(f"{where}: parameter {name!r}: {error}") from None
    if kind != "bool" and not note["low"]:
        raise ShaderError(f"{where}: parameter {name!r} needs a range, e.g. //@ [0, 10] mm ...")
    slider, log_scale = _slider(note["slider"], low, high, f"{where}: parameter {name!r}")
    help = note["help"].strip()
    parameter = Parameter(
        name, kind, default, low, high, note["unit"], help, Path(file), line, slider, log_scale
    )
    if problem := parameter.problem(default):
        raise ShaderError(f"{where}: parameter {name!r}: the default {problem}")
    return parameter


def _slider(
    text: str | None, low: float, high: float, where: str
) -> tuple[tuple[float, float] | None, bool]:
    """Read the part of a note that is for sliders: its range and its scale. Raises ShaderError."""
    if text is None:
        return None, False
    match = _SLIDER.match(text)
    if match is None or not text.strip():
        raise ShaderError(f"{where}: after ';' write a range, 'log' or both, not {text.strip()!r}")
    shown = None
    if match["low"] is not None:
        try:
            shown = _number(match["low"]), _number(match["high"])
        except ValueError as error:
            raise ShaderError(f"{where}: {error}") from None
        if not low <= shown[0] < shown[1] <= high:
            raise ShaderError(
                f"{where}: the slider's range {list(shown)} must lie in [{low:g}, {high:g}]"
            )
    log_scale = match["log"] is not None
    if log_scale and (shown or (low, high))[0] <= 0:
        raise ShaderError(f"{where}: a logarithmic slider starts above 0")
    return shown, log_scale


def _number(text: str) -> float:
    words = {"true": 1.0, "false": 0.0}
    stripped = text.strip().rstrip("uf")
    if text.strip() in words:
        return words[text.strip()]
    try:
        return float(stripped)
    except ValueError:
        raise ValueError(f"{text.strip()!r} is not a plain number") from None
