// turns: whole turns of phases, from them the distance, and from it the depth, as in libfreenect2.
// The slow phase unwraps the fast one, the third phase tells in which turn the slow one is. The
// distance is the unweighted mean over the three numbers of cycles.
#include "lib/tof.glsl"
#include "lib/loops.glsl"

const int MOST_TURNS = 64;

// Cycles of the three phases with their whole turns. phase: cycles, 0 to 1.
vec3 unwrapped_cycles(vec3 phase) {
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
    return vec3(fast, slow, third);
}

// Half the path of light, m, from unwrapped cycles.
float distance_of(vec3 whole) {
    vec3 f = u_modulation_mhz;
    return (whole.x + whole.y + whole.z) * HALF_WAVE_M_MHZ / (f.x + f.y + f.z);
}

// Depth, m, from half the path emitter, surface, camera: |P| + |P - E| = path, P = z (ray, 1).
float along_axis(float distance_m, vec2 ray) {
    vec3 direction = vec3(ray, 1.0);
    float path = 2.0 * distance_m;
    return (path * path - dot(u_emitter_m, u_emitter_m))
        / (2.0 * max(path * length(direction) - dot(direction, u_emitter_m), 1e-6));
}
