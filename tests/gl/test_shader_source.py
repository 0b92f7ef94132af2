"""GLSL files as text: declarations, includes, the line map, and the driver's view of them."""

import os
from fractions import Fraction
from pathlib import Path
from typing import Any

import moderngl
import pytest

from glsim.core import reason
from glsim.core.errors import ShaderError
from glsim.core.reason import Reason
from glsim.gl.includes import SHADER_ROOT
from glsim.gl.program import link
from glsim.gl.shader_source import load_source
from glsim.noise.layer_names import IMAGE_CONSTANTS
from glsim.noise.registry import shipped_stages

HEAD = "#version 330 core\n// mine: a stage of my own\n"
MAIN = "uniform sampler2D u_depth;\nout float depth;\nvoid main() { depth = gain; }\n"
GOOD = "uniform float gain = 1.5; //@ [0, 10] mm how much is added\n"


def write(folder: Path, text: str, name: str = "mine.glsl") -> Path:
    file = folder / name
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)
    return file


def test_a_declaration_is_read_whole(tmp_path: Path) -> None:
    source = load_source(write(tmp_path, HEAD + GOOD + MAIN))
    p = source.parameters["gain"]
    assert (p.name, p.type, p.default, p.low, p.high, p.unit) == ("gain", "float", 1.5, 0, 10, "mm")
    assert p.help == "how much is added"
    assert (p.file.name, p.line) == ("mine.glsl", 3)
    assert source.title == "mine: a stage of my own"
    assert source.reads == ("depth",)
    assert [(w.name, w.type, w.scale) for w in source.writes] == [("depth", "float", 1)]


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("uniform int n = 3; //@ [1, 8] 1 how many", ("int", 3.0, 1.0, 8.0, "1")),
        ("uniform bool on = true; //@ 1 whether", ("bool", 1.0, 0.0, 1.0, "1")),
        ("uniform bool on=false;//@ 1 whether", ("bool", 0.0, 0.0, 1.0, "1")),
        ("  uniform  float  x  =  -2.5e-3 ;  //@  [-1e-2 , 1]  mm/m^2  x", None),
        ("uniform float x = 1.f; //@ [0, 2] 1 x", ("float", 1.0, 0.0, 2.0, "1")),
    ],
)
def test_all_types_and_spellings(
    tmp_path: Path, line: str, expected: tuple[str, float, float, float, str] | None
) -> None:
    (p,) = load_source(write(tmp_path, f"{HEAD}{line}\n")).parameters.values()
    expected = expected or ("float", -0.0025, -0.01, 1.0, "mm/m^2")
    assert (p.type, p.default, p.low, p.high, p.unit) == expected


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("uniform float gain;", "'gain' needs a default and a note, e.g. uniform float gain"),
        ("uniform float gain; //@ [0, 1] mm help", "'gain' needs a default and a note"),
        ("uniform bool gain = true; //@ [0, 1] 1", "'gain' needs a default and a note"),
        ("uniform float gain = 1.0; //@ mm help", "parameter 'gain' needs a range"),
        ("uniform float gain = 1.0; //@ [0, many] mm help", "'many' is not a plain number"),
        ("uniform float gain = PI; //@ [0, 10] mm help", "'PI' is not a plain number"),
        ("uniform float gain = 11.0; //@ [0, 10] mm help", r"default 11 is outside \[0, 10\] mm"),
        ("uniform float gain = 1.0; //@ [10, 0] mm help", r"default 1 is outside \[10, 0\]"),
        ("uniform int gain = 1.5; //@ [0, 10] mm help", "default 1.5 is not a whole number"),
        ("uniform float gain = 1e999; //@ [0, 10] mm help", "default inf is not a finite"),
        ("uniform vec2 gain = vec2(1); //@ [0, 10] mm help", "must be float, int or bool, not vec"),
        ("uniform float a = 1.0, b = 2.0; //@ [0, 1] mm x", "'1.0, b = 2.0' is not a plain n"),
        ("uniform sampler2D u_depth; uniform sampler2D u_lit;", "declare one uniform or layer a"),
        ("uniform highp float gain = 1.0; //@ [0, 1] mm x", "declare one uniform or layer a line"),
        ("layout(std140) uniform Block {", "declare one uniform or layer a line"),
        ("out float depth, reason;", "declare one uniform or layer a line, .*'out float depth, r"),
        ("out vec3 colour;", "a written layer is float, vec2, vec4, not vec3"),
        ('#include "nothing.glsl"', '#include "nothing.glsl": not beside the file nor in'),
        (f'#include "{"9" * 5000}"', "not beside the file"),
        ('#include "a\0b"', "not beside the file"),
        ("out float depth; //@ 1/0", "1/5 to 5 times the frame's, not 1/0"),
        ("out float depth; //@ 99999999999", "1/5 to 5 times"),
        ("uniform float x = " + " " * 100_000 + "1", "a declaration of 100019 characters"),
    ],
)
def test_a_mistake_is_reported_with_file_and_line(tmp_path: Path, line: str, message: str) -> None:
    file = write(tmp_path, HEAD + line + "\n")
    with pytest.raises(ShaderError, match=message) as caught:
        load_source(file)
    assert str(caught.value).startswith(f"{file}:3: ")


def test_a_file_that_is_missing_or_no_text_is_named(tmp_path: Path) -> None:
    with pytest.raises(ShaderError, match=r"absent\.glsl: no such file"):
        load_source(tmp_path / "absent.glsl")
    (tmp_path / "binary.glsl").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ShaderError, match=r"binary\.glsl: .*utf-8"):
        load_source(tmp_path / "binary.glsl")
    with pytest.raises(ShaderError, match="directory"):
        load_source(tmp_path)


def test_layouts_scales_and_bound_uniforms(tmp_path: Path) -> None:
    text = (
        "uniform sampler2D u_depth; /* of the last */\nuniform sampler2D u_lit; // share\n"
        "uniform uint u_seed;\nvoid helper(\n    out float x) {}\n"
        "layout(location = 0) out vec4 a; //@ 1/3 of the frame\nout vec2 b; //@ 2\n"
    )
    source = load_source(write(tmp_path, HEAD + text))
    assert source.reads == ("depth", "lit")
    assert source.bound == ("u_seed",)
    assert [(w.name, w.components, w.scale) for w in source.writes] == [
        ("a", 4, Fraction(1, 3)),
        ("b", 2, Fraction(2)),
    ]


def test_includes_are_found_beside_the_file_first_nested_and_once(tmp_path: Path) -> None:
    write(tmp_path, '#version 330 core\n#include "b.glsl"\nfloat a;\n', "inner/a.glsl")
    write(tmp_path, '#include "a.glsl"\nfloat b;\n', "inner/b.glsl")
    write(tmp_path, "float mine;\n", "lib/random.glsl")
    text = '#include "inner/a.glsl"\n#include <inner/b.glsl>\n#include "lib/random.glsl"\n'
    source = load_source(write(tmp_path, HEAD + text + '#include "lib/depth.glsl"\nend\n'))
    body = [line for line in source.text.splitlines() if line.startswith("float")]
    assert body[:3] == ["float b;", "float a;", "float mine;"]
    assert body[3].startswith("float moved_by_mm")  # not beside the file: the shipped one
    assert source.text.count("#version") == 1
    places = dict(zip(source.text.splitlines(), source.lines, strict=True))
    assert places["float b;"] == (str(tmp_path / "inner/b.glsl"), 2)
    assert places["end"] == (str(tmp_path / "mine.glsl"), 7)
    assert ("lib/depth.glsl", 1) in source.lines
    own = {tmp_path / name for name in ("mine.glsl", "inner/a.glsl", "inner/b.glsl")}
    own.add(tmp_path / "lib/random.glsl")
    assert source.files == own | {SHADER_ROOT / "lib/depth.glsl"}


def test_reason_codes_are_generated_from_the_enumeration(tmp_path: Path) -> None:
    source = load_source(write(tmp_path, HEAD + '#include "reason.glsl"\n'))
    for code in Reason:
        assert f"const float REASON_{code.name} = {code.value}.0;" in source.text
    assert source.text.endswith(reason.glsl())


@pytest.mark.parametrize(
    ("message", "where"),
    [("0:4(7): error: bad", "mine.glsl:4:"), ("0(4) : error C0000: bad", "mine.glsl:4:")],
)
def test_messages_of_mesa_and_of_nvidia_are_located(
    tmp_path: Path, message: str, where: str
) -> None:
    source = load_source(write(tmp_path, HEAD + GOOD + MAIN))
    assert where in source.locate(f"fragment_shader\n====\n{message}\n")
    assert "bad" in source.locate(message)
    assert source.locate("nothing known") == "nothing known"
    assert "0:999(1)" in source.locate("0:999(1): beyond the end")


def test_a_compile_error_in_an_included_file_is_located_there(
    context: moderngl.Context, tmp_path: Path
) -> None:
    inner = write(tmp_path, "// helper\n\nfloat twice(float x) { return 2.0 * y; }\n", "inner.glsl")
    text = HEAD + '#include "inner.glsl"\n' + GOOD + MAIN
    with pytest.raises(ShaderError, match="y") as caught:
        link(context, load_source(write(tmp_path, text)))
    assert f"{inner}:3:" in str(caught.value)
    with pytest.raises(ShaderError) as caught:
        link(context, load_source(write(tmp_path, HEAD + GOOD + MAIN.replace("gain", "loss"))))
    assert f"{tmp_path / 'mine.glsl'}:6:" in str(caught.value)


def test_a_constant_is_defined_after_the_version(context: moderngl.Context, tmp_path: Path) -> None:
    text = HEAD + "out float depth;\nvoid main() { depth = float(SIDE * OTHER); }\n"
    source = load_source(write(tmp_path, text))
    with pytest.raises(ShaderError, match=r"mine\.glsl:4: .*SIDE"):
        link(context, source)
    defined = source.with_defines(SIDE=3, OTHER=5)
    assert defined.text.splitlines()[:3] == [
        "#version 330 core",
        "#define SIDE 3",
        "#define OTHER 5",
    ]
    link(context, defined)
    wrong = load_source(write(tmp_path, text.replace("float(", "flot("))).with_defines(SIDE=3)
    with pytest.raises(ShaderError, match=r"mine\.glsl:4: "):
        link(context, wrong)  # lines are still those of the file


def test_a_constant_that_the_code_does_not_use_is_an_error(tmp_path: Path) -> None:
    source = load_source(write(tmp_path, HEAD + "// SIDE\n/* SIDE */ int SIDES = 3;\n"))
    with pytest.raises(ShaderError, match=r"mine\.glsl: the constant SIDE is defined but not used"):
        source.with_defines(SIDE=3)


def test_the_driver_must_see_what_the_parser_saw(context: moderngl.Context, tmp_path: Path) -> None:
    """The preprocessor may change a declaration after it was parsed."""
    text = HEAD + "#define float int\n" + GOOD + "#undef float\n" + MAIN
    with pytest.raises(ShaderError, match=r"mine.glsl:4: .*'gain'"):
        link(context, load_source(write(tmp_path, text.replace("1.5", "1"))))
    text = HEAD + "#define five 5.0\n#define gain other = 2.0, gain\n" + GOOD + MAIN
    source = load_source(write(tmp_path, text.replace("= gain;", "= 0.0;")))
    assert source.parameters["gain"].default == 1.5
    moved = HEAD + GOOD + "#define SET 1\n" + MAIN
    link(context, load_source(write(tmp_path, moved)))


@pytest.mark.parametrize(
    "name", [name for name, spec in shipped_stages().items() if spec.source is not None]
)
def test_the_parser_agrees_with_the_driver_for_shipped_stages(
    context: moderngl.Context, name: str
) -> None:
    """Every declared parameter is a uniform of this type and default, and there are no others."""
    source = shipped_stages()[name].source
    program: Any = link(context, source)
    types = {0x1406: "float", 0x1404: "int", 0x8B56: "bool"}
    seen = {
        key: (types.get(program[key].gl_type), float(program[key].value))
        for key in program
        if isinstance(program[key], moderngl.Uniform) and not key.startswith("u_")
    }
    assert set(seen) == set(source.parameters), "declared but unused, or used but not declared"
    for key, parameter in source.parameters.items():
        assert seen[key] == (parameter.type, pytest.approx(parameter.default, rel=1e-6))
    samplers = {k[2:] for k in program if k.startswith("u_")} - {n[2:] for n in source.bound}
    # Compiled for sensors with such an image, and where the layer is wanted.
    left_out = {*IMAGE_CONSTANTS, "expected"}
    assert samplers <= set(source.reads) <= samplers | left_out
    assert source.title.startswith(f"{name}: ")
    assert source.file.is_relative_to(SHADER_ROOT)


def test_glsl_files_are_small_regular_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.glsl")
    with pytest.raises(ShaderError, match="is a pipe"):
        load_source(tmp_path / "pipe.glsl")
    with (tmp_path / "huge.glsl").open("wb") as file:
        file.truncate(10 << 30)
    with pytest.raises(ShaderError, match=r"MB are more than the 1\.0"):
        load_source(tmp_path / "huge.glsl")


def test_only_the_first_lines_of_a_drivers_message_are_kept(here: Path) -> None:
    """A wrong include gave messages of 10,000 characters. Long paths would be cut."""
    source = load_source(Path(write(here, HEAD + GOOD + MAIN).name))
    message = "\n".join(f"0:{line % 5 + 1}(3): error: `x{line}' undeclared" for line in range(500))
    located = source.locate(message)
    assert located.startswith(f"{source.file}:1: error: `x0'")
    assert "`x20'" not in located
    assert located.endswith("; and 480 more lines")
    assert "`x19'" in located
    assert len(source.locate("x" * 9000)) < 2010
    assert "\n" not in source.locate("a\nb")
