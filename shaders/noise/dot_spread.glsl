#version 330 core
// dot_spread: gives each pixel the depth of the nearest matched dot, or none.
// This makes the blobs and ragged silhouettes of structured light. Requires correlation_window.
#include "lib/dots.glsl"
#include "lib/layers.glsl"
#include "reason.glsl"

uniform float radius_px = 3.1;  //@ [0.5, 3.9] px distance over which a dot's depth is taken (BlenSor, render_kinect: 3.1)
uniform float edge_mm = 20.0;   //@ [1, 1000]  mm difference of the clean depths of pixel and dot beyond which they are two surfaces

uniform sampler2D u_depth;
uniform sampler2D u_reason;
uniform sampler2D u_clean;
uniform sampler2D u_dot_match;

out float depth;
out float reason;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float here = texelFetch(u_depth, pixel, 0).r;
    reason = texelFetch(u_reason, pixel, 0).r;
    float nearest = radius_px * radius_px;
    ivec2 source = ivec2(-1);
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) { // dots two cells away are 4 px away or more
            ivec2 cell = pixel / CELL_PX + ivec2(x, y);
            int match = int(fetch(u_dot_match, cell));
            ivec2 place = place_pixel(cell, match - 1);
            vec2 offset = vec2(place - pixel);
            float squared = dot(offset, offset);
            if (match > 0 && squared < nearest) {
                nearest = squared;
                source = place;
            }
        }
    }
    depth = fetch(u_depth, source);
    if (depth <= 0.0) {
        if (here > 0.0) reason = REASON_WINDOW;
        return;
    }
    // Clean depths tell surfaces apart: at large depth one step of disparity exceeds edge_mm.
    float own = texelFetch(u_clean, pixel, 0).r, taken = texelFetch(u_clean, source, 0).r;
    bool other = own > 0.0 && taken > 0.0 && abs(taken - own) > 0.001 * edge_mm;
    if (here <= 0.0) {
        reason = own > 0.0 ? REASON_MOVED : REASON_GROWN;
    } else if (other) {
        reason = REASON_MOVED;
    }
}
