// alike: Gaussian noise that is alike in neighbours, as all that has passed the decoder's 3x3 filter.
#include "lib/random.glsl"
#include "lib/kernel.glsl"

// 1 / sqrt(sum of the squares of the kernel's weights)
const float KERNEL_UNIT = 2.99791;

// Variance 1 over the frame.
float alike_noise(ivec2 pixel, uint seed) {
    float noise = 0.0;
    for (int y = -1; y <= 1; y++) {
        uint row = pcg_word(seed ^ pcg_word(uint(pixel.y + y)));
        for (int x = -1; x <= 1; x++) {
            // Two uniform numbers of 16 bits, variance 1/12 each: after the mean over 3x3 as good as
            // normal (excess kurtosis -0.07).
            uint bits = pcg_word(row + uint(pixel.x + x));
            float white = float(int((bits >> 16u) + (bits & 0xffffu)) - 0xffff);
            noise += kernel(ivec2(x, y)) * white;
        }
    }
    return KERNEL_UNIT * 3.73772e-5 * noise; // sqrt(6) / 65536
}
