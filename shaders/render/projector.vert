#version 330 core
// projector: transforms the mesh into the emitter's view; only the z-buffer is kept.
uniform mat4 u_view; // canonical mm -> emitter m
uniform mat4 u_clip;

in vec3 in_position_mm;

void main() {
    gl_Position = u_clip * (u_view * vec4(in_position_mm, 1.0));
}
