#version 330 core
// lateral: samples the depth at a jittered position, which moves edges.
// Within one surface the depth is interpolated; at an edge it is the nearest pixel's.
// Default: 1.6 mm of Fankhauser et al. 2015 at 0.9 m (Kinect V2).
#include "lib/random.glsl"
#include "lib/layers.glsl"
#include "reason.glsl"

uniform float sigma_px = 0.65;  //@ [0, 4]    px standard deviation of the jitter in x and in y
uniform float angle_px = 0.0;   //@ [0, 1]    px growth with the angle a: this times a / (pi/2 - a) (Nguyen et al. 2012: 0.035)
uniform float edge_mm = 20.0;   //@ [1, 1000] mm depth difference between pixels that makes an edge

uniform sampler2D u_depth;
uniform sampler2D u_reason;
uniform sampler2D u_clean;
uniform sampler2D u_normal;
uniform uint u_seed;

out float depth;
out float reason;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float here = texelFetch(u_depth, pixel, 0).r;
    reason = texelFetch(u_reason, pixel, 0).r;
    float angle = acos(clamp(-texelFetch(u_normal, pixel, 0).z, 0.0, 1.0));
    float sigma = sigma_px + angle_px * min(angle / max(1.57079632679 - angle, 1e-3), 20.0);
    vec2 jitter = clamp(sigma, 0.0, 4.0) * normal_pair(random_bits(pixel, u_seed, 0u).xy);
    vec2 at = vec2(pixel) + clamp(jitter, -8.0, 8.0);
    ivec2 corner = ivec2(floor(at));
    vec2 t = at - vec2(corner);
    float d00 = fetch(u_depth, corner), d10 = fetch(u_depth, corner + ivec2(1, 0));
    float d01 = fetch(u_depth, corner + ivec2(0, 1)), d11 = fetch(u_depth, corner + ivec2(1, 1));
    float low = min(min(d00, d10), min(d01, d11)), high = max(max(d00, d10), max(d01, d11));
    if (low > 0.0 && high - low <= 0.001 * edge_mm) {
        depth = mix(mix(d00, d10, t.x), mix(d01, d11, t.x), t.y);
    } else {
        depth = t.y < 0.5 ? (t.x < 0.5 ? d00 : d10) : (t.x < 0.5 ? d01 : d11);
    }
    if (depth <= 0.0) {
        if (here > 0.0) reason = REASON_EDGE;
    } else if (here <= 0.0) {
        reason = texelFetch(u_clean, pixel, 0).r > 0.0 ? REASON_MOVED : REASON_GROWN;
    } else if (abs(depth - here) > 0.001 * edge_mm) {
        reason = REASON_MOVED;
    }
}
