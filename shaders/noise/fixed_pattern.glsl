#version 330 core
// fixed_pattern: adds an error per pixel that is the same in every frame of a device.
// Defaults: measured on Kinect V2 recordings: 0.72-0.91 mm in total, rows alternate by -0.17 and
// +0.20 mm, errors are correlated along columns.
//@ sparse
#include "lib/random.glsl"
#include "lib/depth.glsl"

uniform float pixel_sigma_mm = 0.6;   //@ [0, 20] mm standard deviation of the error of a pixel
uniform float column_sigma_mm = 0.45; //@ [0, 20] mm standard deviation of the error shared by a column
uniform float row_step_mm = 0.37;     //@ [0, 20] mm difference between odd and even rows

uniform sampler2D u_depth;
uniform uint u_device_seed;

out float depth;

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_depth, 0));
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float own = normal_pair(random_bits(pixel, u_device_seed, 0u).xy).x;
    float column = normal_pair(random_bits(ivec2(pixel.x, 0), u_device_seed, 1u).xy).x;
    float row = (pixel.y & 1) == 1 ? 0.5 : -0.5;
    float error = pixel_sigma_mm * own + column_sigma_mm * column + row_step_mm * row;
    depth = moved_by_mm(textureLod(u_depth, here, 0.0).r, error);
}
