// field: sampling position and seed of a noise field.
// Without drift each frame has its own field. With drift the frames of a sequence move through one
// field along its third axis.
#include "lib/random.glsl"

uniform uint u_seed;          // of this stage in this frame
uniform uint u_sequence_seed; // of this stage in this sequence
uniform float u_time_s;       // since the start of the sequence

uint field_seed(float drift_hz) {
    return drift_hz > 0.0 ? u_sequence_seed : u_seed;
}

// The lattice has a random origin; otherwise the field is weak near the same pixels in every frame.
// It lies within three cells, the period of the simplex lattice along an axis.
vec3 field_position(vec2 lattice_px, float drift_hz) {
    uvec4 bits = random_bits(ivec2(0), field_seed(drift_hz), 0xf1e1du);
    vec3 start = 3.0 * vec3(uniform01(bits.x), uniform01(bits.y), uniform01(bits.z));
    return start + vec3(gl_FragCoord.xy / lattice_px, u_time_s * drift_hz);
}
