// folds: the relief of cloth that is finer than its mesh, as depth in front of it.
// Cloth that hangs or is pulled buckles: tension T against bending stiffness B, over a length L, gives folds
// 2 sqrt(pi) (B / T)^1/4 L^1/2 apart (Cerda and Mahadevan, Phys. Rev. Lett. 90, 074302, 2003): 25 to 60 mm for shirts
// of B = 5 uN m (0.05 gf cm2/cm: Kawabata, Hand Evaluation, 1980), T = 1 N/m and L = 20 to 130 mm. Two such distances are drawn.
#ifdef FOLDS
in vec4 v_fold;   // place among the folds that hang; w: their height, mm
in vec4 v_crease; // the same of creases where cloth piles up

float hashed(vec3 cell) {
    uvec3 at = uvec3(ivec3(cell)) * uvec3(0x8DA6B343u, 0xD8163841u, 0xCB1AB31Fu); // as in noise.py
    uint bits = at.x ^ at.y ^ at.z;
    bits = (bits ^ (bits >> 15u)) * 0x2C1B3C6Du;
    bits = (bits ^ (bits >> 12u)) * 0x297A2D39u;
    return float((bits ^ (bits >> 15u)) >> 8u) * (2.0 / 16777215.0) - 1.0;
}

// Smooth noise, -1 to 1, with about one bump per unit length.
float bumps(vec3 place) {
    vec3 low = floor(place), away = place - low, fade = away * away * (3.0 - 2.0 * away), up = vec3(0, 0, 1);
    vec4 near = vec4(hashed(low), hashed(low + vec3(1, 0, 0)), hashed(low + vec3(0, 1, 0)), hashed(low + vec3(1, 1, 0)));
    low += up;
    vec4 far = vec4(hashed(low), hashed(low + vec3(1, 0, 0)), hashed(low + vec3(0, 1, 0)), hashed(low + vec3(1, 1, 0)));
    vec4 between = mix(near, far, fade.z);
    vec2 row = mix(between.xz, between.yw, fade.x);
    return mix(row.x, row.y, fade.y);
}

// Relative height of a fold, 0 to 1: narrow crests where the noise is 0. A quarter of the cloth is crest: chosen.
float crest(float noise) {
    return 1.0 / (1.0 + noise * noise / 0.08);
}

// The place on the folds in front of a place on the mesh, camera frame, m.
vec3 folded(vec3 position_m) {
    // Fine folds lie on one side of the coarse ones, so that they end and form no rings.
    float coarse = bumps(0.4 * v_fold.xyz), side = smoothstep(-0.45, 0.0, coarse);
    float height_mm = v_fold.w * (side * crest(bumps(v_fold.xyz)) + 1.5 * crest(coarse)) + v_crease.w * crest(bumps(v_crease.xyz));
    return position_m * (1.0 - 0.001 * height_mm / position_m.z);
}
#endif
