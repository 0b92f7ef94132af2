#version 330 core
// gaussian: adds white Gaussian noise, in depth or in disparity.
#include "lib/random.glsl"
#include "lib/disparity.glsl"

uniform float sigma_mm = 1.0;  //@ [0, 100] mm standard deviation in depth
uniform float sigma_px = 0.0;  //@ [0, 5]   px standard deviation in disparity (render_kinect: 0.15)

uniform sampler2D u_depth;
uniform uint u_seed;

out float depth;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec2 noise = normal_pair(random_bits(pixel, u_seed, 0u).xy);
    depth = displaced(texelFetch(u_depth, pixel, 0).r, sigma_mm * noise.x, sigma_px * noise.y);
}
