// alike: Gaussian noise that is alike in neighbours, as all that has passed the decoder's 3x3 filter.
#include "lib/random.glsl"
#include "lib/kernel.glsl"

// 1 / sqrt(sum of the squares of the kernel's weights)
const float KERNEL_UNIT = 2.99791;

// Variance 1 over the frame.
float alike_noise(ivec2 pixel, uint seed) {
    float noise = 0.0;
    for (int y = -1; y <= 1; y++) {
        for (int x = -1; x <= 1; x++) {
            // Four uniform numbers, variance 1/12 each: after the mean over 3x3 as good as normal.
            uvec4 bits = random_bits(pixel + ivec2(x, y), seed, 0u);
            float white = uniform01(bits.x) + uniform01(bits.y) + uniform01(bits.z) + uniform01(bits.w);
            noise += kernel(ivec2(x, y)) * (white - 2.0) * 1.73205080757;
        }
    }
    return KERNEL_UNIT * noise;
}
