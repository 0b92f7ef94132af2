// alike: Gaussian noise that is alike in neighbours, as all that has passed the decoder's 3x3 filter.
#include "lib/random.glsl"
#include "lib/kernel.glsl"
#include "lib/loops.glsl"

// 1 / sqrt(sum of the squares of the kernel's weights)
const float KERNEL_UNIT = 2.99791;

// Variance 1 over the frame; drawn only where wanted.
float alike_noise(ivec2 pixel, uint seed, bool wanted) {
    float noise = 0.0;
    int k = wanted ? 0 : 8;
    do {
        ivec2 offset = ivec2(k % 3, k / 3) - 1;
        // Four uniform numbers, variance 1/12 each: after the mean over 3x3 as good as normal.
        uvec4 bits = random_bits(pixel + offset, seed, 0u);
        float white = uniform01(bits.x) + uniform01(bits.y) + uniform01(bits.z) + uniform01(bits.w);
        noise += kernel(offset) * (white - 2.0) * 1.73205080757;
    } while (++k < 9);
    return KERNEL_UNIT * noise;
}
