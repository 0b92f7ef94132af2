#version 330 core
// tof_edge: libfreenect2's edge filter: removes pixels between two surfaces, and those that the
// bilateral filter has marked.
#include "lib/loops.glsl"
#include "reason.glsl"

uniform float min_contrast = 0.05;  //@ [0, 10]   1  standard deviation over mean of the infrared in 3x3 (libfreenect2: edge_ab_std_dev_threshold)
uniform float min_mean = 50.0;      //@ [0, 1e5]  1  the mean is taken to be this at least (edge_ab_avg_min_value)
uniform float nearest_mm = 50.0;    //@ [0, 5000] mm how far the nearest depth in 3x3 must be (edge_close_delta_threshold)
uniform float farthest_mm = 30.0;   //@ [0, 5000] mm how far the farthest (edge_far_delta_threshold)
uniform float larger_mm = 100.0;    //@ [0, 5000] mm how far one of both (edge_max_delta_threshold)
uniform bool remove_mixed = true;   //@           1  whether pixels that the bilateral filter marked are removed

uniform sampler2D u_decoded;
uniform sampler2D u_depth;
uniform sampler2D u_reason;
uniform vec2 u_frame_size_px;

out float depth;
out float reason;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = texelFetch(u_depth, pixel, 0).r;
    reason = texelFetch(u_reason, pixel, 0).r;
    vec4 own = texelFetch(u_decoded, pixel, 0);
    ivec2 last = ivec2(u_frame_size_px) - 1;
    bool wanted = own.x > 0.0 && !any(equal(pixel, ivec2(0))) && !any(equal(pixel, last));
    float sum = 0.0, squares = 0.0, low = own.x, high = own.x;
    int k = wanted ? 0 : 8;
    do {
        vec4 other = texelFetch(u_decoded, pixel + ivec2(k % 3, k / 3) - 1, 0);
        sum += other.z;
        squares += other.z * other.z;
        float z = k != 4 && other.y > 0.0 ? other.y : own.x;
        low = min(low, z);
        high = max(high, z);
    } while (++k < 9);
    float spread = sqrt(max(9.0 * squares - sum * sum, 0.0)) / 9.0;
    float contrast = spread / max(sum / 9.0, min_mean);
    float near_mm = 1000.0 * (own.x - low), far_mm = 1000.0 * (high - own.x);
    bool between = contrast >= min_contrast && near_mm > nearest_mm && far_mm > farthest_mm
        && max(near_mm, far_mm) > larger_mm;
    bool mixed = remove_mixed && own.w > 0.0;
    if (wanted && (between || mixed)) {
        depth = 0.0;
        reason = between ? REASON_EDGE : REASON_MIXED;
    }
}
