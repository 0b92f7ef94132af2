"""Compile and link GL programs, and compare them with their declared parameters."""

from __future__ import annotations

from typing import Any, NamedTuple

import moderngl
import numpy as np
from numpy.typing import NDArray

from glsim.core.errors import ShaderError
from glsim.gl.includes import SHADER_ROOT
from glsim.gl.shader_source import ShaderSource, load_source
from glsim.gl.targets import set_matrix

_GL_TYPES = {"float": 0x1406, "int": 0x1404, "bool": 0x8B56}


def link(
    context: moderngl.Context, fragment: ShaderSource, vertex: ShaderSource | None = None
) -> moderngl.Program:
    """Compile and link a program; outputs are bound in the order of their declaration.

    Raises ShaderError with the driver's message at file:line of the sources. Also raises it if the
    driver reports another type or default of a parameter than the declaration.

    ``vertex``: the vertex shader; default: a triangle that covers the viewport.
    """
    vertex = vertex or load_source(SHADER_ROOT / "render" / "fullscreen.vert")
    outputs = {layer.name: number for number, layer in enumerate(fragment.writes)}
    try:
        program = context.program(
            vertex_shader=vertex.text, fragment_shader=fragment.text, fragment_outputs=outputs
        )
    except Exception as error:  # moderngl.Error is not exported with a stable name
        source = vertex if "vertex_shader" in str(error) else fragment
        raise ShaderError(f"{source.file}: {source.locate(str(error))}") from None
    for name, parameter in fragment.parameters.items():
        uniform: Any = program.get(name, None)
        if uniform is None:
            continue  # declared but unused, and so removed by the driver
        where = f"{parameter.file}:{parameter.line}"
        if uniform.gl_type != _GL_TYPES[parameter.type]:
            raise ShaderError(f"{where}: the driver does not see {name!r} as {parameter.type}")
        if abs(float(uniform.value) - parameter.default) > 1e-6 * max(1, abs(parameter.default)):
            raise ShaderError(
                f"{where}: the driver sees the default {uniform.value} of {name!r}, "
                f"not {parameter.default}"
            )
    return program


class MeshPrograms(NamedTuple):
    """The programs that draw surfaces, sheets of strands and cloth with folds (shaders/lib/)."""

    surface: moderngl.Program
    strands: moderngl.Program
    folds: moderngl.Program

    def set_matrix(self, name: str, matrix: NDArray[np.float32]) -> None:
        """Set a matrix uniform of all programs."""
        for program in self:
            set_matrix(program, name, matrix)


def link_meshes(
    context: moderngl.Context, fragment: str, vertex: str, samples: int = 1
) -> MeshPrograms:
    """Link the programs that draw meshes, from paths below shaders/. Raises ShaderError."""
    sources = load_source(SHADER_ROOT / fragment), load_source(SHADER_ROOT / vertex)
    strands = sources[0].with_defines(STRANDS=1, SAMPLES_PER_AXIS=samples)
    sheets = link(context, strands, sources[1].with_defines(STRANDS=1))
    plain = cloth = link(context, *sources)
    if "FOLDS" in sources[0].text:  # depth shows folds; shadows and regions do without
        cloth = link(context, *(source.with_defines(FOLDS=1) for source in sources))
    return MeshPrograms(plain, sheets, cloth)


def link_files(
    context: moderngl.Context, fragment: str, vertex: str | None = None
) -> moderngl.Program:
    """Link a program of shipped files, given by paths below shaders/. Raises ShaderError."""
    source = load_source(SHADER_ROOT / fragment)
    return link(context, source, None if vertex is None else load_source(SHADER_ROOT / vertex))
