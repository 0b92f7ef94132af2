#version 330 core
// max_filter: takes the farthest depth of a square window: silhouettes grow.
// Mu et al. 2019 (Led3D) coarsen depth maps of faces this way, window 3x3.
#include "lib/layers.glsl"
#include "reason.glsl"

uniform int radius_px = 1;  //@ [0, 4] px radius of the window: its side is 2 radius + 1

uniform sampler2D u_depth;
uniform sampler2D u_reason;
uniform sampler2D u_clean;

out float depth;
out float reason;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float here = texelFetch(u_depth, pixel, 0).r;
    reason = texelFetch(u_reason, pixel, 0).r;
    depth = here;
    for (int y = -radius_px; y <= radius_px; y++) {
        for (int x = -radius_px; x <= radius_px; x++) {
            depth = max(depth, fetch(u_depth, pixel + ivec2(x, y)));
        }
    }
    if (depth > 0.0 && here <= 0.0) {
        reason = texelFetch(u_clean, pixel, 0).r > 0.0 ? REASON_MOVED : REASON_GROWN;
    }
}
