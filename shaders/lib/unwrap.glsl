// unwrap: phases to a distance, and a distance to a depth, as in libfreenect2.
// All three phases must agree and be bright enough.
#include "lib/turns.glsl"
#include "reason.glsl"

uniform float min_amplitude = 3.0;     //@ [0, 1000]  1   minimum amplitude of each frequency (libfreenect2: individual_ab_threshold)
uniform float min_sum = 10.0;          //@ [0, 3000]  1   minimum sum of the three amplitudes (ab_threshold)
uniform float slope = -0.5330578;      //@ [-10, 10]  1   slope of log(allowed disagreement) over log(amplitude) (ab_confidence_slope)
uniform float offset = 0.7694894;      //@ [-10, 10]  1   log(allowed disagreement) at amplitude 1 (ab_confidence_offset)
uniform float min_disagreement = 0.3490659; //@ [0, 10] rad smallest allowed disagreement (min_dealias_confidence)
uniform float max_disagreement = 0.6108653; //@ [0, 10] rad largest allowed disagreement (max_dealias_confidence)

const float LOG10_2 = 0.301030, LOG2_10 = 3.321928; // as the decoder rounds them

const int DECODED = 0, DARK = 1, DISAGREES = 2;

// Distance, m. sum: of the amplitudes; fate: DECODED, DARK or DISAGREES.
float unwrapped(vec3 real, vec3 imaginary, out float sum, out int fate) {
    vec3 amplitude = sqrt(real * real + imaginary * imaginary);
    float least = min(amplitude.x, min(amplitude.y, amplitude.z));
    float most = max(amplitude.x, max(amplitude.y, amplitude.z));
    sum = amplitude.x + amplitude.y + amplitude.z;
    vec3 phase = fract(atan(imaginary, real) / TWO_PI); // cycles, 0 to 1

    vec3 whole = unwrapped_cycles(phase);
    vec3 disagreement = cross(TWO_PI * whole, normalize(u_modulation_mhz));
    float allowed = exp((log(max(most, 1e-6)) * slope * LOG10_2 + offset) * LOG2_10);
    allowed = clamp(allowed, min_disagreement, max_disagreement);
    bool agrees = dot(disagreement, disagreement) <= allowed * allowed;
    fate = least < min_amplitude || sum < min_sum ? DARK : (agrees ? DECODED : DISAGREES);
    return distance_of(whole);
}

float reason_of(int fate, float z, float clean, float lit) {
    float dark = lit < 0.5 ? REASON_SHADOW : REASON_LOW_SIGNAL;
    if (fate == DARK) return clean <= 0.0 ? REASON_NO_SURFACE : dark;
    if (fate == DISAGREES || z <= 0.0) return clean > 0.0 && lit < 0.5 ? REASON_SHADOW : REASON_UNWRAP;
    return clean <= 0.0 ? REASON_GROWN : REASON_VALID;
}
