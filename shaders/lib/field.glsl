// field: where a noise field is sampled, and with which seed.
// Without drift each frame has a field of its own; with drift the frames of a sequence move
// through one field along its third axis.
uniform uint u_seed;          // of this stage in this frame
uniform uint u_sequence_seed; // of this stage in this sequence
uniform float u_time_s;       // since the start of the sequence

uint field_seed(float drift_hz) {
    return drift_hz > 0.0 ? u_sequence_seed : u_seed;
}

// A start on the third axis from the seed, so that no field begins on a lattice plane.
vec3 field_position(vec2 lattice_px, float drift_hz) {
    uint start = random_bits(ivec2(0), field_seed(drift_hz), 0xf1e1du).x;
    return vec3(gl_FragCoord.xy / lattice_px, uniform01(start) + u_time_s * drift_hz);
}
