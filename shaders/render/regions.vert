#version 330 core
// regions: transforms a mesh into the camera's view, with the region number of each triangle.
#include "lib/strand_sheets.glsl"

uniform mat4 u_view; // canonical mm -> camera m
uniform mat4 u_clip;

in vec3 in_position_mm;
in float in_region;

flat out float v_region; // taken from the triangle's last vertex

void main() {
    vec4 position = u_view * vec4(in_position_mm, 1.0);
    pass_strands(position);
    v_region = in_region;
    gl_Position = u_clip * position;
}
