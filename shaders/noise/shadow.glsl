#version 330 core
// shadow: removes pixels that the emitters do not light.
// Mallick, Das and Majumdar 2014 call this shadow noise.
#include "reason.glsl"

uniform float min_lit = 0.5;  //@ [0, 1] 1 minimum share of the emitters that lights a pixel

uniform sampler2D u_depth;
uniform sampler2D u_reason;
uniform sampler2D u_lit;

out float depth;
out float reason;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = texelFetch(u_depth, pixel, 0).r;
    reason = texelFetch(u_reason, pixel, 0).r;
    if (depth > 0.0 && texelFetch(u_lit, pixel, 0).r < min_lit) {
        depth = 0.0;
        reason = REASON_SHADOW;
    }
}
