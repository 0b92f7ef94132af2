#version 330 core
// projector: writes the z-buffer only.
#include "lib/strands.glsl"
#ifdef STRANDS
uniform mat4 u_clip;
#endif

void main() {
#ifdef STRANDS
    vec4 clip = u_clip * vec4(0.0, 0.0, strand_seen(1.0).x, 1.0);
    gl_FragDepth = 0.5 + 0.5 * clip.z / clip.w;
#endif
}
