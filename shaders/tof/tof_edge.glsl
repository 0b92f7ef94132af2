#version 330 core
// tof_edge: removes pixels between two surfaces (libfreenect2's edge filter).
// Pixels that the bilateral filter marked are removed too.
//@ sparse
#include "reason.glsl"

uniform float min_contrast = 0.05;  //@ [0, 10]   1  minimum standard deviation over mean of the infrared in 3x3 (libfreenect2: edge_ab_std_dev_threshold)
uniform float min_mean = 50.0;      //@ [0, 1e5]  1  lower limit of that mean (edge_ab_avg_min_value)
uniform float nearest_mm = 50.0;    //@ [0, 5000] mm minimum distance to the nearest depth in 3x3 (edge_close_delta_threshold)
uniform float farthest_mm = 30.0;   //@ [0, 5000] mm minimum distance to the farthest depth (edge_far_delta_threshold)
uniform float larger_mm = 100.0;    //@ [0, 5000] mm minimum of the larger of both distances (edge_max_delta_threshold)
uniform bool remove_mixed = true;   //@           1  whether pixels marked by the bilateral filter are removed
uniform float least_marked = 1.0;   //@ [1, 5]    1  fewest marked pixels in 3x3 with which a marked pixel is removed; others are if at most that many are not marked

uniform sampler2D u_decoded;
uniform sampler2D u_depth;
uniform sampler2D u_reason;
uniform vec2 u_frame_size_px;

out float depth;
out float reason;

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_decoded, 0));
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = textureLod(u_depth, here, 0.0).r;
    reason = textureLod(u_reason, here, 0.0).r;
    vec2 own = textureLod(u_decoded, here, 0.0).rg;
    float sum = own.y, squares = own.y * own.y, low = depth, high = depth;
    float marked = float(own.x <= 0.0);
    vec2 texel = 1.0 / vec2(textureSize(u_decoded, 0));
    for (int k = 0; k < 8; k++) { // without the centre
        ivec2 offset = ivec2((k + int(k > 3)) % 3, (k + int(k > 3)) / 3) - 1;
        vec2 other = textureLod(u_decoded, (gl_FragCoord.xy + vec2(offset)) * texel, 0.0).rg;
        marked += float(other.x <= 0.0);
        sum += other.y;
        squares += other.y * other.y;
        low = min(low, other.x > 0.0 ? other.x : depth);
        high = max(high, other.x > 0.0 ? other.x : depth);
    }
    float spread = sqrt(max(9.0 * squares - sum * sum, 0.0)) / 9.0;
    float contrast = spread / max(sum / 9.0, min_mean);
    float near_mm = 1000.0 * (depth - low), far_mm = 1000.0 * (high - depth);
    bool between = contrast >= min_contrast && near_mm > nearest_mm && far_mm > farthest_mm
        && max(near_mm, far_mm) > larger_mm;
    bool mixed = remove_mixed && marked >= (own.x <= 0.0 ? least_marked : 10.0 - least_marked);
    ivec2 last = ivec2(u_frame_size_px) - 1;
    bool inside = !any(equal(pixel, ivec2(0))) && !any(equal(pixel, last)); // as the decoder does
    if (depth > 0.0 && inside && (between || mixed)) {
        depth = 0.0;
        reason = between ? REASON_EDGE : REASON_MIXED;
    }
}
