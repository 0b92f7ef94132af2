#version 330 core
// single_view_noise: adds the noise and the losses of a stereo camera, and rounds disparities.
// A statistical model of stereo_light, stereo_exposure and match_stereo; after single_view_match.
#include "lib/support.glsl"
#include "lib/layers.glsl"
#include "reason.glsl"

uniform float growth_across_px = 1.0; //@ [-8, 8] px how far near surfaces grow over far ones, across the baseline
uniform float rim_px = 3.0;          //@ [0, 31]  px a far surface is lost this near a nearer one
uniform float sigma_px = 0.045;      //@ [0, 2]   px standard deviation of disparity near by, from frame to frame
uniform float sigma_px_per_m = 0.035; //@ [0, 1]   px/m its growth with distance: dots fade
uniform float most_sigma_px = 0.2;   //@ [0, 2]   px upper limit of the standard deviation
uniform float device_sigma_px = 0.05;  //@ [0, 1] px standard deviation of the device's own error, the same in all frames
uniform float length_along_px = 9.0; //@ [1, 16]  px lattice of this noise along the baseline: half of the correlation at 0.87 of it
uniform float length_across_px = 6.5; //@ [1, 16] px and across it
uniform float tail = 0.6;            //@ [0, 0.8] 1  heavy tails: the noise is scaled by a smooth log-normal number; excess kurtosis 3 exp(4 tail^2) - 3
uniform float white_share = 0.05;    //@ [0, 1]   1  share of the variance that is white
uniform float dark_albedo = 0.01;    //@ [0, 1]   1  albedo times cosine at 1 m at which half of the pixels have too little texture of dots
uniform float dark_spread = 0.8;     //@ [0, 3]   1  standard deviation of the logarithm of that threshold
uniform float steps_per_px = 32.0;   //@ [1, 256] 1/px steps of the disparity

uniform sampler2D u_disparity;
uniform sampler2D u_fate;
uniform sampler2D u_clean;
uniform sampler2D u_normal;
uniform sampler2D u_albedo;
uniform sampler2D u_rays;
uniform uint u_device_seed;
uniform float u_focal_baseline_px_m;

out float depth;
out float reason;

float disparity_at(ivec2 pixel) {
    return fetch(u_disparity, pixel);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), axis = abs(along_baseline());
    float bumps = lattice_noise(pixel, vec2(rough_length_px), u_seed);
    float before = disparity_at(pixel);
    float own = support_disparity(pixel, axis.yx, vec2(growth_across_px + rough_px * bumps));
    bool grown = own > before + support_step_px;
    float near = 0.0;
    int k = 0;
    do {
        vec2 way = vec2(cos(0.785398163 * float(k)), sin(0.785398163 * float(k)));
        near = max(near, disparity_at(pixel + ivec2(floor(rim_px * way + 0.5))));
    } while (++k < 8);

    float z = u_focal_baseline_px_m / max(own, 1e-3);
    vec2 spacing = vec2(axis) * length_along_px + vec2(axis.yx) * length_across_px;
    float sigma = min(sqrt(sigma_px * sigma_px + sigma_px_per_m * sigma_px_per_m * z * z), most_sigma_px);
    float white = normal_pair(random_bits(pixel, u_seed, 0u).xy).x;
    float noise = sqrt(1.0 - white_share) * lattice_noise(pixel, spacing, u_seed + 1u)
        + sqrt(white_share) * white;
    noise *= sigma * exp(tail * bumps - tail * tail); // the mean of the square of this factor is 1
    float device = device_sigma_px * lattice_noise(pixel, spacing, u_device_seed);
    float steps = max(floor(steps_per_px * (own + noise + device) + 0.5), 1.0);

    vec3 normal = texelFetch(u_normal, pixel, 0).xyz;
    vec3 direction = normalize(vec3(texelFetch(u_rays, pixel, 0).rg, 1.0));
    float clean = texelFetch(u_clean, pixel, 0).r;
    float light = texelFetch(u_albedo, pixel, 0).r * max(-dot(normal, direction), 0.0) / max(clean, 1e-3);
    float limit = dark_albedo * exp(dark_spread * bumps);

    reason = texelFetch(u_fate, pixel, 0).r;
    bool elsewhere = abs(own - u_focal_baseline_px_m / max(clean, 1e-3)) > support_step_px;
    if (reason == REASON_VALID || grown) {
        reason = clean <= 0.0 ? REASON_GROWN : (elsewhere ? REASON_MOVED : REASON_VALID);
        if (clean > 0.0 && !elsewhere && light < limit) reason = REASON_LOW_SIGNAL;
        if (near > own + rim_step_px) reason = REASON_EDGE;
    }
    bool found = reason == REASON_VALID || reason == REASON_GROWN || reason == REASON_MOVED;
    depth = found ? u_focal_baseline_px_m * steps_per_px / steps : 0.0;
}
