#version 330 core
// fixed_pattern: adds an error per pixel that is the same in every frame of a device.
// Defaults: between those of real Kinect V2s: columns 0.05 mm (44 frames of one) and 0.2 to 0.29 mm
// (others), single pixels 0.17 and 0.29, smooth over 3x3 pixels because the decoder filters them. Neighbouring rows alternate by
// -0.69 mm and +0.69 mm in frames that libfreenect2 decoded, with the opposite sign below the middle row: two
// devices share size and sign, and 44 frames of one show the change of sign within one row. Why is not known.
// Frames of Microsoft's SDK have none, or one that changes slowly down the image: of four devices 0, at most
// 0.08, rising from 0 to 0.54 and back, and 0.35, 0.23, -0.18, -0.36, 0.40, -0.07, -0.32 from the top.
// A sensor with a map of its own pattern (rig.fixed_pattern_map) has that; pixels that the map does
// not know are drawn.
//@ sparse
#include "lib/correlated_noise.glsl"
#include "lib/depth.glsl"

uniform float pixel_sigma_mm = 0.22;  //@ [0, 20] mm standard deviation of the error of a pixel, smooth over 3x3
uniform float column_sigma_mm = 0.1;  //@ [0, 20] mm standard deviation of the error shared by a column
uniform float row_sigma_mm = 0.25;    //@ [0, 20] mm standard deviation of the error shared by a row
uniform float row_alternation_mm = 0.69; //@ [0, 20] mm error of opposite sign in odd and even rows, and in the two halves of the image: odd rows of the upper half are nearer
uniform float row_profile_mm = 0.0;   //@ [0, 20] mm standard deviation of an error of opposite sign in odd and even rows that changes slowly down the image
uniform float row_step_mm = 0.0;      //@ [-20, 20] mm difference between odd and even rows, the same in all of the image and in all devices

uniform sampler2D u_depth;
uniform sampler2D u_pattern_map; // mm; NO_PATTERN (glsim/noise/chain.py), 1e6, where it is unknown
uniform uint u_device_seed;
uniform vec2 u_frame_size_px;

const float PROFILE_STEPS = 6.0; // of the slow error down the image; measured: it changes its sign within a sixth

out float depth;

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_depth, 0));
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float own = correlated_noise(pixel, u_device_seed);
    float column = normal_pair(random_bits(ivec2(pixel.x, 0), u_device_seed, 1u).xy).x;
    float row = normal_pair(random_bits(ivec2(0, pixel.y), u_device_seed, 2u).xy).x;
    float half_sign = 2 * pixel.y < int(u_frame_size_px.y) ? -1.0 : 1.0;
    float place = PROFILE_STEPS * (float(pixel.y) + 0.5) / u_frame_size_px.y, step = floor(place);
    float above = normal_pair(random_bits(ivec2(1, int(step)), u_device_seed, 3u).xy).x;
    float below = normal_pair(random_bits(ivec2(1, int(step) + 1), u_device_seed, 3u).xy).x;
    float profile = row_profile_mm * mix(above, below, place - step);
    float odd = (pixel.y & 1) == 1 ? 1.0 : -1.0;
    float error = pixel_sigma_mm * own + column_sigma_mm * column + row_sigma_mm * row
        + odd * (row_alternation_mm * half_sign + profile + 0.5 * row_step_mm);
#ifdef PATTERN_MAP
    float measured = texelFetch(u_pattern_map, pixel, 0).r;
    error = measured < 1e5 ? measured : error;
#endif
    depth = moved_by_mm(textureLod(u_depth, here, 0.0).r, error);
}
