// lattice_noise: random fields of variance 1 with any correlation length, all at the same cost.
// Random numbers stand on a lattice; quadratic B-splines blend the nine nearest ones.
#include "lib/random.glsl"

// A node's number: the sum of four bytes, mean 510, variance 4 (256^2 - 1) / 12, nearly normal
// (excess kurtosis -0.3, less after blending).
float lattice_node(uint word) {
    uint sum = (word & 255u) + ((word >> 8u) & 255u) + ((word >> 16u) & 255u) + (word >> 24u);
    return (float(sum) - 510.0) * 6.76583e-3;
}

// The field at a pixel. spacing_px: between nodes along x and y; at 0.83 of it the correlation is
// one half. The origin is random, and the variance is 1 between nodes as it is at them.
float lattice_noise(ivec2 pixel, vec2 spacing_px, uint seed) {
    uint key = pcg_word(seed);
    vec2 place = vec2(pixel) / spacing_px + vec2(uniform01(key), uniform01(pcg_word(key)));
    vec2 node = floor(place + 0.5), t = place - node; // t: -0.5 to 0.5
    vec2 before = 0.5 * (0.5 - t) * (0.5 - t), after = 0.5 * (0.5 + t) * (0.5 + t);
    vec2 middle = 0.75 - t * t;
    vec2 squares = before * before + middle * middle + after * after;
    uvec2 first = uvec2(ivec2(node) - 1);
    float sum = 0.0;
    for (uint j = 0u; j < 3u; j++) {
        uint row = pcg_word(key ^ pcg_word(first.y + j));
        float along = before.x * lattice_node(pcg_word(row + first.x))
            + middle.x * lattice_node(pcg_word(row + first.x + 1u))
            + after.x * lattice_node(pcg_word(row + first.x + 2u));
        sum += (j == 0u ? before.y : (j == 1u ? middle.y : after.y)) * along;
    }
    return sum * inversesqrt(squares.x * squares.y);
}

// The share of a normal variable that lies below n, within 0.0003: turns a field into one that is
// uniform in (0, 1). The tanh form of Hendrycks and Gimpel 2016 (their GELU).
float normal_share(float n) {
    return 0.5 + 0.5 * tanh(0.7978846 * (n + 0.044715 * n * n * n));
}
