#version 330 core
// identify: a mesh under an orthographic matrix, for finding out which triangles can be seen.
uniform mat4 u_clip;

in vec3 in_position_mm;

void main() {
    gl_Position = u_clip * vec4(in_position_mm, 1.0);
}
