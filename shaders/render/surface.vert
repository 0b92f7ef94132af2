#version 330 core
// surface: transforms a mesh into the camera's view, with its position for the layers.
#include "lib/strand_sheets.glsl"

uniform mat4 u_view; // canonical mm -> camera m
uniform mat4 u_clip;

in vec3 in_position_mm;
in float in_albedo;

out vec3 v_position_m;
out float v_albedo;

void main() {
    vec4 position = u_view * vec4(in_position_mm, 1.0);
    pass_strands(position);
    v_position_m = position.xyz;
    v_albedo = in_albedo;
    gl_Position = u_clip * position;
}
