// simplex: simplex noise on a seeded lattice of tetrahedra, about -1 to 1.
// Perlin 2001 in the form of Gustavson, "Simplex noise demystified", 2005: skew 1/3, unskew 1/6,
// gradients the 12 edges of a cube. The kernel's radius^2 is 0.5: it ends where its corner's
// tetrahedra end. The paper's 0.6 leaves steps of 0.5 % between them. The result reaches 1.
#include "lib/perlin.glsl"

float simplex_corner(ivec3 node, vec3 offset, uint seed) {
    uvec3 n = uvec3(node);
    uint hash = pcg_word(pcg_word(pcg_word(seed ^ pcg_word(n.z)) + n.y) + n.x);
    float t = max(0.5 - dot(offset, offset), 0.0);
    return t * t * t * t * lattice_gradient(hash, offset);
}

float simplex(vec3 at, uint seed) {
    vec3 cell = floor(at + dot(at, vec3(1.0 / 3.0)));
    vec3 x0 = at - cell + dot(cell, vec3(1.0 / 6.0));
    // Rank the coordinates: the inner corners step along the largest one, then along the two largest.
    vec3 ge = vec3(x0.x >= x0.y, x0.y >= x0.z, x0.x >= x0.z);
    vec3 rank = vec3(ge.x + ge.z, 1.0 - ge.x + ge.y, 2.0 - ge.y - ge.z);
    vec3 first = step(2.0, rank);
    vec3 second = step(1.0, rank);
    vec3 x1 = x0 - first + 1.0 / 6.0;
    vec3 x2 = x0 - second + 1.0 / 3.0;
    vec3 x3 = x0 - 0.5;
    ivec3 n = ivec3(cell);
    return 76.0 * (simplex_corner(n, x0, seed) + simplex_corner(n + ivec3(first), x1, seed) +
        simplex_corner(n + ivec3(second), x2, seed) + simplex_corner(n + ivec3(1), x3, seed));
}
