#version 330 core
// dot_spread: every pixel takes the depth of the nearest matched dot, or none.
// This gives the blobs and the ragged silhouettes of structured light. Needs correlation_window.
#include "lib/dots.glsl"
#include "lib/layers.glsl"
#include "reason.glsl"

uniform float radius_px = 3.1;  //@ [0.5, 5] px how far the depth of a dot reaches (BlenSor, render_kinect: 3.1)

uniform sampler2D u_depth;
uniform sampler2D u_reason;
uniform sampler2D u_clean;
uniform sampler2D u_dot_match;

const int REACH_CELLS = 2; // of 3 px: covers the largest radius

out float depth;
out float reason;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float here = texelFetch(u_depth, pixel, 0).r;
    reason = texelFetch(u_reason, pixel, 0).r;
    depth = 0.0;
    float nearest = radius_px * radius_px;
    for (int y = -REACH_CELLS; y <= REACH_CELLS; y++) {
        for (int x = -REACH_CELLS; x <= REACH_CELLS; x++) {
            ivec2 cell = pixel / CELL_PX + ivec2(x, y);
            if (fetch(u_dot_match, cell) <= 0.0) continue;
            ivec2 place = dot_pixel(cell);
            vec2 offset = vec2(place - pixel);
            float squared = dot(offset, offset);
            if (squared < nearest) {
                nearest = squared;
                depth = fetch(u_depth, place);
            }
        }
    }
    if (depth <= 0.0) {
        if (here > 0.0) reason = REASON_WINDOW;
    } else if (here <= 0.0) {
        reason = texelFetch(u_clean, pixel, 0).r > 0.0 ? REASON_MOVED : REASON_GROWN;
    }
}
