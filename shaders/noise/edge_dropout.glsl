#version 330 core
// edge_dropout: removes pixels beside depth edges at random.
#include "lib/random.glsl"
#include "lib/layers.glsl"
#include "reason.glsl"

uniform float probability = 0.5;    //@ [0, 1]    1  probability that a pixel beside an edge is removed
uniform float threshold_mm = 30.0;  //@ [1, 5000] mm depth difference that makes an edge; missing depth always makes one
uniform int radius_px = 1;          //@ [1, 4]    px how far from an edge pixels are removed

uniform sampler2D u_depth;
uniform sampler2D u_reason;
uniform uint u_seed;

out float depth;
out float reason;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = texelFetch(u_depth, pixel, 0).r;
    reason = texelFetch(u_reason, pixel, 0).r;
    if (depth <= 0.0 || uniform01(random_bits(pixel, u_seed, 0u).x) >= probability) return;
    float here = depth;
    for (int y = -radius_px; y <= radius_px; y++) {
        for (int x = -radius_px; x <= radius_px; x++) {
            float there = fetch(u_depth, pixel + ivec2(x, y));
            if (there <= 0.0 || abs(there - here) > 0.001 * threshold_mm) {
                depth = 0.0;
                reason = REASON_EDGE;
            }
        }
    }
}
