#version 330 core
// tof_unwrap: unwraps phases to depth along the axis, as in libfreenect2.
//@ sparse
#include "lib/unwrap.glsl"

uniform sampler2D u_phasor_a;
uniform sampler2D u_phasor_b;
uniform sampler2D u_clean;
uniform sampler2D u_lit;
uniform sampler2D u_rays;

out float depth;
out float reason;
out float infrared;
out vec2 decoded; // depth in m, 0 if marked as an edge; sum of amplitudes

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_clean, 0));
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 a = textureLod(u_phasor_a, here, 0.0), b = textureLod(u_phasor_b, here, 0.0);
    vec3 real = vec3(a.xz, b.x), imaginary = vec3(a.yw, b.y);
    float sum;
    int fate;
    float distance_m = unwrapped(real, imaginary, sum, fate);
    float z = along_axis(distance_m, textureLod(u_rays, here, 0.0).rg);
    float clean = textureLod(u_clean, here, 0.0).r;
    float lit = textureLod(u_lit, here, 0.0).r;
    reason = reason_of(fate, z, clean, lit);
    if (b.w >= 2.0) reason = REASON_SATURATED;
    depth = reason == REASON_VALID || reason == REASON_GROWN ? z : 0.0;
    infrared = b.z;
    bool edge = b.w == 1.0 || b.w == 3.0;
    decoded = vec2(edge ? 0.0 : depth, sum);
}
