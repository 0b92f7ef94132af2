// random: numbers as a function of (pixel, seed, draw), never of a state.
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

// Open interval (0, 1), 24 bits: exact in float32, so that the NumPy twin gives the same number.
float uniform01(uint bits) {
    return (float(bits >> 8u) + 0.5) * (1.0 / 16777216.0);
}

// Two independent standard normal numbers (Box and Muller 1958) from two words of bits.
vec2 normal_pair(uvec2 bits) {
    float radius = sqrt(-2.0 * log(uniform01(bits.x)));
    float angle = 6.28318530718 * uniform01(bits.y);
    return radius * vec2(cos(angle), sin(angle));
}
