#version 330 core
// tof_floor: the noise of the depth that does not depend on the light: new in every frame, alike in
// neighbours as all that has passed the decoder's 3x3 filter. Where it comes from is not known.
// Where pixels look is a little uncertain too, which moves the depth of slanted surfaces: Fankhauser
// et al. 2015 find twice the noise at 75 degrees that less light explains.
#include "lib/random.glsl"
#include "lib/kernel.glsl"
#include "lib/depth.glsl"
#include "lib/loops.glsl"

uniform float sigma_mm = 1.1;  //@ [0, 50] mm standard deviation; on recordings 1.20 mm of temporal noise at 0.8 m, 0.4 of them from the light
uniform float lateral_px = 0.1; //@ [0, 2]  px standard deviation of where a pixel looks; at 75 degrees Fankhauser's curve asks for 0.3

uniform sampler2D u_depth;
uniform sampler2D u_normal;
uniform sampler2D u_rays;
uniform float u_focal_px;
uniform uint u_seed;

const float STEEPEST = 12.0; // tangent of 85 degrees

// 1 / sqrt(sum of the squares of the kernel's weights)
const float UNIT = 2.99791;

out float depth;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = texelFetch(u_depth, pixel, 0).r;
    bool wanted = depth > 0.0;
    float noise = 0.0;
    int k = wanted ? 0 : 8;
    do {
        ivec2 offset = ivec2(k % 3, k / 3) - 1;
        // Four uniform numbers, variance 1/12 each: after the mean over 3x3 as good as normal.
        uvec4 bits = random_bits(pixel + offset, u_seed, 0u);
        float white = uniform01(bits.x) + uniform01(bits.y) + uniform01(bits.z) + uniform01(bits.w);
        noise += kernel(offset) * (white - 2.0) * 1.73205080757;
    } while (++k < 9);
    vec3 normal = texelFetch(u_normal, pixel, 0).xyz;
    vec3 ray = vec3(texelFetch(u_rays, pixel, 0).rg, 1.0);
    float slope = min(length(normal.xy) / max(-dot(normal, ray), 1e-3), STEEPEST);
    float slanted_mm = lateral_px * slope * 1000.0 * depth / u_focal_px;
    float sigma = sqrt(sigma_mm * sigma_mm + slanted_mm * slanted_mm);
    depth = moved_by_mm(depth, sigma * UNIT * noise);
}
