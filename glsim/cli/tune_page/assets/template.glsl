#version 330 core
// NAME: a new stage. It reads the layers that it declares and writes those that it puts out.
#include "lib/random.glsl"
#include "lib/depth.glsl"

uniform float amount_mm = 2.0; //@ [0, 100; 0, 20] mm standard deviation of the error

uniform sampler2D u_depth; // metres, 0 = none
uniform uint u_seed;       // of this frame and stage

out float depth;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float z = texelFetch(u_depth, pixel, 0).r;
    float noise = normal_pair(random_bits(pixel, u_seed, 0u).xy).x;
    depth = moved_by_mm(z, amount_mm * noise);
}
