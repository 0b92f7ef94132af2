#version 330 core
// projector: transforms the mesh into the emitter's view; only the z-buffer is kept.
#include "lib/strand_sheets.glsl"

uniform mat4 u_view; // canonical mm -> emitter m
uniform mat4 u_clip;

in vec3 in_position_mm;

void main() {
    vec4 position = u_view * vec4(in_position_mm, 1.0);
    pass_strands(position);
    gl_Position = u_clip * position;
}
