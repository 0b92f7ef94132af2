#version 330 core
// regions: transforms a mesh into the camera's view, with the region number of each triangle.
uniform mat4 u_view; // canonical mm -> camera m
uniform mat4 u_clip;

in vec3 in_position_mm;
in float in_region;

flat out float v_region; // taken from the triangle's last vertex

void main() {
    v_region = in_region;
    gl_Position = u_clip * (u_view * vec4(in_position_mm, 1.0));
}
