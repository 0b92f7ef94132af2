// tof: constants and phases of a time-of-flight camera with three frequencies.
// Vectors of three hold the frequencies in the rig's order: fast, slow, fastest (80, 16, 120 MHz).
// Constants of the decoder: libfreenect2, depth_packet_processor.cpp (Parameters).

uniform vec3 u_modulation_mhz;
uniform vec3 u_emitter_m; // where paths of light start: the mean of the emitters, camera frame

const float TWO_PI = 6.28318530718;

// libfreenect2's ab_multiplier_per_frq: contrast at 16 MHz over contrast at each frequency.
const vec3 CONTRAST_MULTIPLIER = vec3(1.322581, 1.0, 1.612903);

// 3e8 m/s, as in the decoder's tables (glsim/noise/rig_checks.py, SPEED_OF_LIGHT).
const float HALF_WAVE_M_MHZ = 150.0;

// Cosines and sines of the three taps' phases 0, 120 and 240 degrees.
const vec3 TAP_COS = vec3(1.0, -0.5, -0.5);
const vec3 TAP_SIN = vec3(0.0, 0.86602540378, -0.86602540378);

// Cycles of each frequency's phase on the way to a distance and back.
vec3 cycles(float distance_m) {
    return distance_m * u_modulation_mhz / HALF_WAVE_M_MHZ;
}

vec2 complex_product(vec2 a, vec2 b) {
    return vec2(a.x * b.x - a.y * b.y, a.x * b.y + a.y * b.x);
}
