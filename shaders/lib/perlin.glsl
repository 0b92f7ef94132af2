// perlin: Perlin noise on a seeded cubic lattice, about -1 to 1.
// Perlin, "Improving Noise", SIGGRAPH 2002: quintic fade, the 12 edges of a cube as gradients.
// Eight corners per sample need a cheaper hash than random_bits: one PCG word per coordinate; the
// words of the outer coordinates are shared between corners.
#include "lib/random.glsl"

float lattice_gradient(uint hash, vec3 offset) {
    uint h = hash >> 28u; // 16 cases: the 12 edges, 4 of them twice
    float a = h < 8u ? offset.x : offset.y;
    float b = h < 4u ? offset.y : (h == 12u || h == 14u ? offset.x : offset.z);
    return ((h & 1u) == 0u ? a : -a) + ((h & 2u) == 0u ? b : -b);
}

float perlin(vec3 at, uint seed) {
    vec3 whole = floor(at);
    vec3 f = at - whole;
    uvec3 n = uvec3(ivec3(whole));
    vec3 t = f * f * f * (f * (f * 6.0 - 15.0) + 10.0);
    float plane[2] = float[2](0.0, 0.0);
    uint planes = t.z > 0.0 ? 2u : 1u; // on a plane of nodes the next plane has weight 0
    for (uint k = 0u; k < planes; k++) {
        uint hz = pcg_word(seed ^ pcg_word(n.z + k));
        float row[2];
        for (uint j = 0u; j < 2u; j++) {
            uint hy = pcg_word(hz + n.y + j);
            vec3 offset = f - vec3(0.0, float(j), float(k));
            float left = lattice_gradient(pcg_word(hy + n.x), offset);
            offset.x -= 1.0;
            row[j] = mix(left, lattice_gradient(pcg_word(hy + n.x + 1u), offset), t.x);
        }
        plane[k] = mix(row[0], row[1], t.y);
    }
    return mix(plane[0], plane[1], t.z);
}
