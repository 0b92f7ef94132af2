#version 330 core
// tof_floor: the noise of the depth that does not depend on the light: new in every frame, alike in
// neighbours as all that has passed the decoder's 3x3 filter. Where it comes from is not known.
#include "lib/random.glsl"
#include "lib/kernel.glsl"
#include "lib/depth.glsl"
#include "lib/loops.glsl"

uniform float sigma_mm = 1.1;  //@ [0, 50] mm standard deviation; on recordings 1.20 mm of temporal noise at 0.8 m, 0.4 of them from the light

uniform sampler2D u_depth;
uniform uint u_seed;

// 1 / sqrt(sum of the squares of the kernel's weights)
const float UNIT = 2.99791;

out float depth;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = texelFetch(u_depth, pixel, 0).r;
    bool wanted = depth > 0.0 && sigma_mm > 0.0;
    float noise = 0.0;
    int k = wanted ? 0 : 8;
    do {
        ivec2 offset = ivec2(k % 3, k / 3) - 1;
        // Four uniform numbers, variance 1/12 each: after the mean over 3x3 as good as normal.
        uvec4 bits = random_bits(pixel + offset, u_seed, 0u);
        float white = uniform01(bits.x) + uniform01(bits.y) + uniform01(bits.z) + uniform01(bits.w);
        noise += kernel(offset) * (white - 2.0) * 1.73205080757;
    } while (++k < 9);
    depth = moved_by_mm(depth, sigma_mm * UNIT * noise);
}
