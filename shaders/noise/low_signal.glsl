#version 330 core
// low_signal: removes pixels that return too little infrared light.
// Default: half of the pixels are removed at 1/78 of white paper's light at 1 m: an albedo of 0.013
// at 1 m, 0.1 at 2.8 m. Chosen; a Kinect V2 loses pixels at less light (tof_unwrap).
#include "lib/random.glsl"
#include "reason.glsl"

uniform float min_counts = 387.468;   //@ [0, 65535] counts infrared at which half of the pixels are removed
uniform float spread_counts = 77.494; //@ [0, 65535] counts standard deviation of that threshold between pixels

uniform sampler2D u_depth;
uniform sampler2D u_reason;
uniform sampler2D u_infrared;
uniform uint u_seed;

out float depth;
out float reason;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = texelFetch(u_depth, pixel, 0).r;
    reason = texelFetch(u_reason, pixel, 0).r;
    float limit = min_counts + spread_counts * normal_pair(random_bits(pixel, u_seed, 0u).xy).x;
    if (depth > 0.0 && texelFetch(u_infrared, pixel, 0).r < limit) {
        depth = 0.0;
        reason = REASON_LOW_SIGNAL;
    }
}
