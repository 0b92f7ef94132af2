#version 330 core
// any_camera_noise: adds the noise and the systematic error of some unknown depth camera.
// Domain randomisation (docs/howto/any_camera.md). The size of the noise is a law of distance, light and
// angle, its distribution may have heavy tails, and neighbours may be alike. A part of it is noise of
// 1/depth, which is what stereo and structured light measure; a part may stay in all frames of a
// device. The systematic error is the device's: an offset, a scale, a tilt and a wave along the
// distance, with the device's phase.
//@ sparse
#include "lib/lattice_noise.glsl"
#include "lib/skin_signal.glsl"
#include "lib/depth.glsl"

uniform float floor_mm = 0.7;         //@ [0, 20]   mm standard deviation that light and distance do not change
uniform float light_mm = 1.0;         //@ [0, 20]   mm standard deviation of skin at 0.9 m that faces the sensor, by its light
uniform float distance_power = 2.0;   //@ [0, 4]    1  light_mm grows with this power of the distance
uniform float light_power = 1.0;      //@ [0, 1]    1  and falls with this power of albedo times cosine: 1 for time of flight, less for stereo
uniform float max_sigma_mm = 40.0;    //@ [0, 1000] mm upper limit of the standard deviation
uniform float inverse_per_m = 0.0;    //@ [0, 0.1]  1/m standard deviation of 1/depth, which neither distance nor light change
uniform float length_x_px = 1.5;      //@ [1, 16]   px lattice of the correlated noise along a row; block matching over 13 px: 8
uniform float length_y_px = 1.5;      //@ [1, 16]   px and along a column
uniform float static_share = 0.0;     //@ [0, 1]    1  share of the variance of the correlated noise that is the same in all frames of a device
uniform float white_share = 0.3;      //@ [0, 1]    1  share of the variance that is white
uniform float tail = 0.2;             //@ [0, 0.8]  1  heavy tails: each pixel's sigma is scaled by a log-normal number; excess kurtosis 3 exp(4 tail^2) - 3
uniform float outlier_share = 0.0;    //@ [0, 0.05] 1  share of the pixels that are far off
uniform float outlier_mm = 50.0;      //@ [0, 1000] mm standard deviation of these
uniform float smooth_mm = 0.2;        //@ [0, 10]   mm standard deviation of a smooth error, new in each frame
uniform float smooth_px = 30.0;       //@ [8, 512]  px lattice of the smooth error
uniform float wiggle_mm = 1.2;        //@ [0, 20]   mm amplitude of the wave along the distance
uniform float wiggle_period_m = 0.4;  //@ [0.05, 10] m period of the wave; its phase is the device's own
uniform float offset_mm = 0.0;        //@ [-100, 100] mm error everywhere
uniform float scale_mm_per_m = 0.0;   //@ [-50, 50] mm/m error that grows with distance
uniform float tilt_x_mm = 0.0;        //@ [-50, 50] mm error at the right border, of opposite sign at the left
uniform float tilt_y_mm = 0.0;        //@ [-50, 50] mm error at the lower border, of opposite sign at the upper

uniform sampler2D u_depth;
uniform sampler2D u_normal;
uniform sampler2D u_albedo;
uniform sampler2D u_rays;
uniform uint u_seed;
uniform uint u_device_seed;
uniform vec2 u_frame_size_px;
#ifdef EXPECTED
uniform sampler2D u_expected;
#endif

out float depth;
#ifdef EXPECTED
out float expected;
#endif

const float DARKEST = 0.04; // of skin: darker surfaces have no more noise

// What the device measures too much at a depth, mm.
float systematic_mm(float z) {
    float phase = uniform01(pcg_word(u_device_seed));
    vec2 beside = 2.0 * gl_FragCoord.xy / u_frame_size_px - 1.0;
    float turns = fract(z / wiggle_period_m + phase);
    return offset_mm + scale_mm_per_m * z + dot(vec2(tilt_x_mm, tilt_y_mm), beside)
        + wiggle_mm * sin(6.28318530718 * turns);
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float z = texelFetch(u_depth, pixel, 0).r;
    vec2 ray = texelFetch(u_rays, pixel, 0).rg;
    vec3 normal = texelFetch(u_normal, pixel, 0).xyz;
    float light = skin_signal(USUAL_M, texelFetch(u_albedo, pixel, 0).r, normal, ray);
    // A pixel that grew over nothing has the light of skin.
    light = dot(normal, normal) > 0.0 ? max(light, DARKEST) : 1.0;
    float by_light = light_mm * pow(max(z, 1e-3) / USUAL_M, distance_power) * pow(light, -light_power);
    float by_inverse = 1000.0 * inverse_per_m * z * z;
    float sigma = sqrt(floor_mm * floor_mm + by_light * by_light + by_inverse * by_inverse);
    sigma = min(sigma, max_sigma_mm);

    uvec4 bits = random_bits(pixel, u_seed, 0u);
    vec2 white = normal_pair(bits.xy), second = normal_pair(bits.zw);
    vec2 spacing = vec2(length_x_px, length_y_px);
    float field = sqrt(1.0 - static_share) * lattice_noise(pixel, spacing, u_seed)
        + sqrt(static_share) * lattice_noise(pixel, spacing, u_device_seed + 1u);
    float noise = sqrt(white_share) * white.x + sqrt(1.0 - white_share) * field;
    noise *= exp(tail * white.y - tail * tail); // the mean of the square of this factor is 1
    float error = sigma * noise + smooth_mm * lattice_noise(pixel, vec2(smooth_px), u_seed + 1u);
    error += uniform01(pcg_word(bits.x)) < outlier_share ? outlier_mm * second.x : 0.0;
    depth = moved_by_mm(z, error + systematic_mm(z));
#ifdef EXPECTED
    float right = texelFetch(u_expected, pixel, 0).r;
    expected = moved_by_mm(right, systematic_mm(right));
#endif
}
