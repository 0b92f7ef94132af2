// random: random numbers as a function of (pixel, seed, draw), without state.
// pcg4d of Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT 9(3), 2020.

uvec4 random_bits(ivec2 pixel, uint seed, uint draw) {
    uvec4 v = uvec4(uvec2(pixel), seed, draw) * 1664525u + 1013904223u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    v ^= v >> 16u;
    v.x += v.y * v.w;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v.w += v.y * v.z;
    return v;
}

// One random word, three times cheaper: PCG (O'Neill 2014, RXS-M-XS 32). Nest calls for more inputs.
uint pcg_word(uint v) {
    uint state = v * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// Uniform in the open interval (0, 1), with 23 bits. With the added half this is float32's precision:
// nothing is rounded to 1, and the NumPy twin gives the same number.
float uniform01(uint bits) {
    return (float(bits >> 9u) + 0.5) * (1.0 / 8388608.0);
}

// Two independent standard normal numbers (Box and Muller 1958) from two random words.
vec2 normal_pair(uvec2 bits) {
    float radius = sqrt(max(-2.0 * log(uniform01(bits.x)), 0.0)); // a GPU's log just below 1 may exceed 0
    float angle = 6.28318530718 * uniform01(bits.y);
    return radius * vec2(cos(angle), sin(angle));
}
