#version 330 core
// identify: projects a mesh by an orthographic matrix, to find its visible triangles.
uniform mat4 u_clip;

in vec3 in_position_mm;

void main() {
    gl_Position = u_clip * vec4(in_position_mm, 1.0);
}
