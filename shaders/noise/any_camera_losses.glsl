#version 330 core
// any_camera_losses: removes pixels as some unknown depth camera would, and rounds disparities.
// Domain randomisation (docs/howto/any_camera.md): pixels lost one by one and in clusters, too little and
// too much light, and grazing surfaces.
//@ sparse
#include "lib/lattice_noise.glsl"
#include "lib/skin_signal.glsl"
#include "reason.glsl"

uniform float single_share = 0.002;    //@ [0, 0.2] 1  share of pixels lost one by one
uniform float cluster_share = 0.002;   //@ [0, 0.2] 1  share of pixels lost in clusters
uniform float cluster_px = 3.0;        //@ [1, 16]  px lattice of the clusters
uniform float dark_signal = 0.02;      //@ [0, 10]  1  light at which half of the pixels are lost; skin at 0.9 m is 1
uniform float dark_spread = 0.3;       //@ [0, 3]   1  standard deviation of the logarithm of that threshold; half of its variance in clusters
uniform float grazing_cosine = 0.1;    //@ [0, 1]   1  cosine of the angle to the ray below which pixels are lost
uniform float grazing_spread = 0.05;   //@ [0, 1]   1  standard deviation of that threshold
uniform float saturated_signal = 20.0; //@ [0.1, 1e6] 1 light beyond which pixels are lost; skin at 0.9 m is 1
uniform float step_px = 0.0;           //@ [0, 4]   px step of the disparity, 0: none; depth becomes a constant over a whole number
uniform float focal_baseline_px_mm = 21000.0; //@ [100, 1e6] px mm focal length times baseline, for step_px; 1/32 px of the default is a step of 1.5 mm at 1 m

uniform sampler2D u_depth;
uniform sampler2D u_reason;
uniform sampler2D u_normal;
uniform sampler2D u_albedo;
uniform sampler2D u_rays;
uniform uint u_seed;

out float depth;
out float reason;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = texelFetch(u_depth, pixel, 0).r;
    reason = texelFetch(u_reason, pixel, 0).r;
    vec2 ray = texelFetch(u_rays, pixel, 0).rg;
    vec3 normal = texelFetch(u_normal, pixel, 0).xyz;
    bool known = dot(normal, normal) > 0.0; // a pixel that grew over nothing is as bright as skin
    float signal = known ? skin_signal(depth, texelFetch(u_albedo, pixel, 0).r, normal, ray) : 1.0;
    float cosine = known ? -dot(normal, normalize(vec3(ray, 1.0))) : 1.0;

    uvec4 bits = random_bits(pixel, u_seed, 0u);
    vec2 white = normal_pair(bits.xy);
    float clusters = lattice_noise(pixel, vec2(cluster_px), u_seed);
    float apart = 0.70710678 * (white.x + lattice_noise(pixel, vec2(cluster_px), u_seed + 1u));
    float fate = REASON_VALID;
    if (uniform01(bits.z) < single_share) fate = REASON_DROPPED;
    if (normal_share(clusters) < cluster_share) fate = REASON_DROPPED;
    if (signal > saturated_signal) fate = REASON_SATURATED;
    if (cosine < grazing_cosine + grazing_spread * white.y) fate = REASON_LOW_SIGNAL;
    if (signal < dark_signal * exp(dark_spread * apart)) fate = REASON_LOW_SIGNAL;
    float step_per_m = 1000.0 * step_px / focal_baseline_px_mm; // of the inverse depth
    if (depth > 0.0 && step_per_m > 0.0) {
        depth = 1.0 / (step_per_m * max(floor(1.0 / (depth * step_per_m) + 0.5), 1.0));
    }
    if (depth > 0.0 && fate != REASON_VALID) {
        depth = 0.0;
        reason = fate;
    }
}
