"""Parse GLSL lines that declare a parameter or a layer, with the note after ``//@``.

    uniform float base_sigma_mm = 1.5;  //@ [0, 20] mm  standard deviation at 1 m

declares a parameter: its type, name and default in GLSL; then range, unit ("1" for none) and help.
After a semicolon the brackets configure the slider: ``//@ [0, 65535; 0, 2000] counts ...`` shows 0
to 2000, ``//@ [0.1, 1e6; log] 1 ...`` has a logarithmic scale, ``[0.1, 1e6; 1, 100 log]`` both, and
``[3, 21; step 2]`` odd numbers only. Boxes and files accept all values of the range.
``uniform sampler2D u_depth;`` declares that the stage reads the layer ``depth``, and
``out float depth;`` that it writes it. ``//@ 1/3`` after an ``out`` makes the written layers a
third of the frame's size. glsim sets the other ``u_`` uniforms, a fixed set
(glsim.noise.stage_pass).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor, isfinite
from pathlib import Path

from glsim.core.errors import ShaderError
from glsim.core.rect import Rect
from glsim.gl.includes import Line

UNIFORM = re.compile(
    r"^\s*uniform\s+(?P<type>\w+)\s+(?P<name>\w+)\s*(?:\[\s*\w+\s*\])?"
    r"\s*(?:=\s*(?P<default>[^;]+?))?\s*;\s*(?://@(?P<note>.*)|//.*|/\*.*)?$"
)
OUT = re.compile(
    r"^\s*(?:layout\s*\([^)]*\)\s*)?out\s+(?P<type>\w+)\s+(?P<name>\w+)\s*;"
    r"(?P<rest>\s*(?:/[/*].*)?)$"
)
#: Lines that begin like a declaration but match no pattern above: several names, a block, ...
_UNREADABLE = re.compile(r"^\s*(?:layout\s*\([^)]*\)\s*)?(?:uniform\s|out\s+\w+\s+[^;()]*;)")
_DECLARATION = re.compile(r"^\s*(?:layout|uniform|out)\b")
_NOTE = re.compile(
    r"^\s*(?:\[(?P<low>[^,;\]]+),(?P<high>[^,;\]]+)(?:;(?P<slider>[^\]]*))?\])?"
    r"\s*(?P<unit>[^\s\[]\S*)\s+(?P<help>\S.*)$"
)
#: The slider part of a note: two numbers, "log" or "step" with a number, or both.
_SLIDER = re.compile(
    r"^\s*(?:(?P<low>[^,\s]+)\s*,\s*(?P<high>[^,\s]+?))?"
    r"\s*(?:(?P<log>\blog)|\bstep\s+(?P<step>\S+))?\s*$"
)
_SCALE = re.compile(r"//@\s*(?P<scale>\d+(?:/\d+)?)\b")
SPARSE = re.compile(r"^//@ sparse\b")
#: Longest line with a declaration, characters; shipped lines have at most 100. The time of the
#: patterns above grows with the square of the length.
_MAX_DECLARATION = 2000
#: Largest size of a written layer relative to the frame's: rigs have up to 5 samples a pixel.
_MAX_SCALE = 5
_PARAMETER_TYPES = {"float": float, "int": int, "bool": bool}
_LAYER_TYPES = {"float": 1, "vec2": 2, "vec4": 4}


@dataclass(frozen=True)
class Parameter:
    """A declared parameter of a stage; its values are floats, also for int and bool.

    ``slider``: range of the slider, if it is smaller than [low, high].
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
    step: float = 0.0

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
    """A layer (an image) that a shader writes; ``scale`` is its size relative to the frame's."""

    name: str
    type: str
    scale: Fraction = Fraction(1)

    @property
    def components(self) -> int:
        """The number of values per pixel."""
        return _LAYER_TYPES[self.type]

    def window(self, frame_window: Rect) -> Rect:
        """Convert a window from frame pixels to the pixels of this layer."""
        if self.scale == 1:
            return frame_window
        left, top, width, height = frame_window
        columns = floor(left * self.scale), ceil((left + width) * self.scale)
        rows = floor(top * self.scale), ceil((top + height) * self.scale)
        return Rect(columns[0], rows[0], columns[1] - columns[0], rows[1] - rows[0])


def match_declaration(line: Line, *, vertex: bool) -> re.Match[str] | None:
    """Match a line with the pattern ``UNIFORM``, or with ``OUT`` outside vertex shaders.

    Raises ShaderError for a declaration that is too long, or that matches neither pattern.
    """
    text = line.text
    if len(text) > _MAX_DECLARATION:
        if _DECLARATION.match(text):
            raise ShaderError(
                f"{line.where}: a declaration of {len(text)} characters, the limit is "
                f"{_MAX_DECLARATION}"
            )
        return None
    if match := UNIFORM.match(text):
        return match
    if match := OUT.match(text):
        return None if vertex else match
    if _UNREADABLE.match(text):
        raise ShaderError(
            f"{line.where}: declare one uniform or layer a line, as 'uniform TYPE NAME' or "
            f"'out TYPE NAME', not {text.strip()!r}"
        )
    return None


def written_layer(match: re.Match[str], where: str) -> Layer:
    """Make the layer that a match of ``OUT`` declares. Raises ShaderError."""
    if match["type"] not in _LAYER_TYPES:
        raise ShaderError(
            f"{where}: a written layer is {', '.join(_LAYER_TYPES)}, not {match['type']}"
        )
    return Layer(match["name"], match["type"], _scale(match["rest"], where))


def _scale(rest: str, where: str) -> Fraction:
    """Read a layer's scale from a note like ``//@ 1/3``; else 1. Raises ShaderError."""
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


def declared_parameter(match: re.Match[str], line: Line) -> Parameter:
    """Make the parameter that a match of ``UNIFORM`` declares. Raises ShaderError."""
    where, name, kind = line.where, match["name"], match["type"]
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
    slider = slider_of(note["slider"], low, high, f"{where}: parameter {name!r}")
    help = note["help"].strip()
    parameter = Parameter(
        name, kind, default, low, high, note["unit"], help, Path(line.file), line.number, *slider
    )
    if problem := parameter.problem(default):
        raise ShaderError(f"{where}: parameter {name!r}: the default {problem}")
    return parameter


def slider_of(
    text: str | None, low: float, high: float, where: str
) -> tuple[tuple[float, float] | None, bool, float]:
    """Read the slider's range, scale and step from a parameter's note. Raises ShaderError.

    Returns the fields ``slider``, ``log_scale`` and ``step`` of a Parameter.

    ``text``: the part of the note after the semicolon; None without a semicolon.
    """
    if text is None:
        return None, False, 0.0
    match = _SLIDER.match(text) if text.strip() else None
    try:
        if match is None:
            raise ValueError("is no range, 'log' or 'step 2', nor a range and one of the two")
        ends = [_number(match[k]) for k in ("low", "high") if match[k] is not None]
        shown = (ends[0], ends[1]) if ends else None
        step = _number(match["step"] or "0")
        if shown is not None and not low <= shown[0] < shown[1] <= high:
            raise ValueError(f"its range must lie in [{low:g}, {high:g}]")
        if match["log"] and (shown or (low, high))[0] <= 0:
            raise ValueError("a logarithmic one starts above 0")
        if match["step"] and not 0 < step <= high - low:
            raise ValueError(f"its step must lie in (0, {high - low:g}]")
    except ValueError as error:
        raise ShaderError(f"{where}: the slider {text.strip()!r}: {error}") from None
    return shown, match["log"] is not None, step


def _number(text: str) -> float:
    plain = {"true": "1", "false": "0"}.get(text.strip(), text.strip())
    try:
        return float(plain.rstrip("uf"))
    except ValueError:
        raise ValueError(f"{plain!r} is not a plain number") from None
