// correlated_noise: Gaussian noise correlated between neighbours, as after the decoder's 3x3 filter.
#include "lib/random.glsl"
#include "lib/kernel.glsl"

// 1 / sqrt(sum of the squares of the kernel's weights)
const float KERNEL_UNIT = 2.99791;

// Noise of variance 1 at a pixel of the frame.
float correlated_noise(ivec2 pixel, uint seed) {
    float noise = 0.0;
    for (int y = -1; y <= 1; y++) {
        uint row = pcg_word(seed ^ pcg_word(uint(pixel.y + y)));
        for (int x = -1; x <= 1; x++) {
            // The sum of two uniform 16-bit numbers, variance 1/12 each: after the mean over 3x3
            // nearly normal (excess kurtosis -0.07).
            uint bits = pcg_word(row + uint(pixel.x + x));
            float white = float(int((bits >> 16u) + (bits & 0xffffu)) - 0xffff);
            noise += kernel(ivec2(x, y)) * white;
        }
    }
    return KERNEL_UNIT * 3.73772e-5 * noise; // sqrt(6) / 65536
}
