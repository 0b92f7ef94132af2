// perlin: gradient noise on a seeded cubic lattice, about -1 to 1.
// Perlin, "Improving Noise", SIGGRAPH 2002: quintic fade, the 12 edges of a cube as gradients.
#include "lib/random.glsl"

float lattice_gradient(ivec3 node, vec3 offset, uint seed) {
    uint h = random_bits(node.xy, seed, uint(node.z)).x >> 28u; // 16 cases: 12 edges, 4 of them twice
    float a = h < 8u ? offset.x : offset.y;
    float b = h < 4u ? offset.y : (h == 12u || h == 14u ? offset.x : offset.z);
    return ((h & 1u) == 0u ? a : -a) + ((h & 2u) == 0u ? b : -b);
}

float perlin(vec3 at, uint seed) {
    vec3 whole = floor(at);
    vec3 f = at - whole;
    ivec3 n = ivec3(whole);
    vec3 t = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    float sum[4];
    for (int corner = 0; corner < 4; corner++) {
        ivec3 c = ivec3(0, corner & 1, corner >> 1);
        float left = lattice_gradient(n + c, f - vec3(c), seed);
        c.x = 1;
        float right = lattice_gradient(n + c, f - vec3(c), seed);
        sum[corner] = mix(left, right, t.x);
    }
    return mix(mix(sum[0], sum[1], t.y), mix(sum[2], sum[3], t.y), t.z);
}
