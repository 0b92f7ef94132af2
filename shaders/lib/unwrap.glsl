// unwrap: phases to a distance, and a distance to a depth, as in libfreenect2.
// The slow phase unwraps the fast one, the third phase tells in which turn the slow one is, and all
// three must agree. The distance is the unweighted mean over the three numbers of cycles.
#include "lib/tof.glsl"
#include "lib/loops.glsl"
#include "reason.glsl"

uniform float min_amplitude = 3.0;     //@ [0, 1000]  1   minimum amplitude of each frequency (libfreenect2: individual_ab_threshold)
uniform float min_sum = 10.0;          //@ [0, 3000]  1   minimum sum of the three amplitudes (ab_threshold)
uniform float slope = -0.5330578;      //@ [-10, 10]  1   slope of log(allowed disagreement) over log(amplitude) (ab_confidence_slope)
uniform float offset = 0.7694894;      //@ [-10, 10]  1   log(allowed disagreement) at amplitude 1 (ab_confidence_offset)
uniform float min_disagreement = 0.3490659; //@ [0, 10] rad smallest allowed disagreement (min_dealias_confidence)
uniform float max_disagreement = 0.6108653; //@ [0, 10] rad largest allowed disagreement (max_dealias_confidence)

const int MOST_TURNS = 64;
const float LOG10_2 = 0.301030, LOG2_10 = 3.321928; // as the decoder rounds them

const int DECODED = 0, DARK = 1, DISAGREES = 2;

// Distance, m. sum: of the amplitudes; fate: DECODED, DARK or DISAGREES.
float unwrapped(vec3 real, vec3 imaginary, out float sum, out int fate) {
    vec3 amplitude = sqrt(real * real + imaginary * imaginary);
    float least = min(amplitude.x, min(amplitude.y, amplitude.z));
    float most = max(amplitude.x, max(amplitude.y, amplitude.z));
    sum = amplitude.x + amplitude.y + amplitude.z;
    vec3 phase = fract(atan(imaginary, real) / TWO_PI); // cycles, 0 to 1

    vec3 f = u_modulation_mhz;
    float ratio = f.x / f.y; // an integer: cycles of the fast phase per cycle of the slow one
    float fast = phase.x + floor(ratio * phase.y - phase.x + 0.5);
    // The turn of the slow phase at which the third one fits best, out of those before all phases
    // repeat (2 for 80, 16 and 120 MHz).
    float best = 1e6, best_turn = 0.0;
    float turns_of_third = f.z / f.y;
    int turn = 0;
    bool more;
    do {
        float third = fast * f.z / f.x + float(turn) * turns_of_third - phase.z;
        float misfit = abs(third - floor(third + 0.5));
        best_turn = misfit < best - 1e-4 ? float(turn) : best_turn;
        best = min(best, misfit);
        turn++;
        more = abs(fract(float(turn) * turns_of_third + 0.5) - 0.5) > 1e-3;
    } while (more && turn < MOST_TURNS);
    fast += best_turn * ratio;
    float slow = phase.y + best_turn;
    float third = phase.z + floor(fast * f.z / f.x - phase.z + 0.5);

    vec3 disagreement = cross(TWO_PI * vec3(fast, slow, third), normalize(f));
    float allowed = exp((log(max(most, 1e-6)) * slope * LOG10_2 + offset) * LOG2_10);
    allowed = clamp(allowed, min_disagreement, max_disagreement);
    bool agrees = dot(disagreement, disagreement) <= allowed * allowed;
    fate = least < min_amplitude || sum < min_sum ? DARK : (agrees ? DECODED : DISAGREES);
    return (fast + slow + third) * HALF_WAVE_M_MHZ / (f.x + f.y + f.z);
}

// Depth, m, from half the path emitter, surface, camera: |P| + |P - E| = path, P = z (ray, 1).
float along_axis(float distance_m, vec2 ray) {
    vec3 direction = vec3(ray, 1.0);
    float path = 2.0 * distance_m;
    return (path * path - dot(u_emitter_m, u_emitter_m))
        / (2.0 * max(path * length(direction) - dot(direction, u_emitter_m), 1e-6));
}

float reason_of(int fate, float z, float clean, float lit) {
    float dark = lit < 0.5 ? REASON_SHADOW : REASON_LOW_SIGNAL;
    if (fate == DARK) return clean <= 0.0 ? REASON_NO_SURFACE : dark;
    if (fate == DISAGREES || z <= 0.0) return clean > 0.0 && lit < 0.5 ? REASON_SHADOW : REASON_UNWRAP;
    return clean <= 0.0 ? REASON_GROWN : REASON_VALID;
}
