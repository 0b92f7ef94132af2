// strands: which samples of a surface meet a strand of hair, and at which depth.
// Hair is drawn as layers of sheets. Cells of the sheet's own coordinates, one strand wide and some strands
// long, hold a strand or a gap, so that the same strands are seen in all frames and by all cameras. A sample
// in a gap sees the next layer, the scalp or the wall, and a pixel is the mixture of its samples.
#ifdef STRANDS
#include "lib/random.glsl"

in vec4 v_strand;  // cell coordinates: two across the strands, one along them; share of cells with a strand
in vec3 v_sheet_m; // the place on the sheet
in float v_sink_m; // the strands of a sheet lie up to this far below it; a halo is minus this far above the hair

const int SAMPLES = SAMPLES_PER_AXIS; // along each axis of a pixel, defined by glsim

// Strands cling together: a tuft of this many strands has more of them or fewer. Chosen.
const float TUFT = 5.0;
// Depth below a sheet in which the light falls by a factor of e. There are 2 hairs/mm2 of scalp (1.5 to 2.3:
// Birnbaum, Skin Appendage Disord. 4, 304, 2018), 0.07 mm thick and 40 mm long (chosen): they fill 1.5 % of
// 20 mm, so that light meets one after pi * 0.07 mm / (4 * 0.015) = 3.6 mm. Hair scatters more light than it
// absorbs: after three of these distances 1 / e is left (chosen between dark and light hair).
const float LOST_M = 0.011;

// Single hairs leave the others: their number falls by a factor of e within FALL_M of the hair, and STRAY is what
// they hide of a ray per m at the hair: of the 2 hairs/mm2 above 3 % are stray, pi / 4 * 0.07 mm * 2 * 0.03 * 2 / mm2
// = 6.6 / m where they are oblique. Both are chosen; so much that no more pixels on real heads are lost than are.
// HEAD_M is the radius of a head.
const float FALL_M = 0.006, STRAY = 6.6, HEAD_M = 0.095;

// A random word for a cell.
uint cell_word(vec3 cell) {
    uvec3 at = uvec3(ivec3(2.0 * cell)) * uvec3(0x8DA6B343u, 0xD8163841u, 0xCB1AB31Fu); // as in noise.py
    uint bits = at.x ^ at.y ^ at.z;
    bits = (bits ^ (bits >> 15u)) * 0x2C1B3C6Du;
    bits = (bits ^ (bits >> 12u)) * 0x297A2D39u;
    return bits ^ (bits >> 15u);
}

// Depth, m, of the stray hair that a sample of a halo meets, or 0. A hair is narrower than a sample: as many samples
// of a pixel meet one as its hairs cover of it, the one in the middle only if they cover half.
// over_m: height of the sheet above the hair; facing: cosine between ray and normal; q: place among the strands.
float stray_hair(float over_m, float facing, vec3 q) {
    vec2 place = mod(floor(gl_FragCoord.xy), float(SAMPLES)) - 0.5 * float(SAMPLES - 1);
    float limit = fract(0.5 + dot(place, vec2(0.754877666, 0.569840291))); // evenly spread: 1 / plastic number
    // The ray passes at this height over a ball of hair, or falls on it.
    float outer = HEAD_M + over_m, sine = sqrt(max(1.0 - facing * facing, 0.0));
    float high = outer * sine - HEAD_M, inside = outer * sine / HEAD_M;
    float most = sqrt(6.2832 * HEAD_M * FALL_M); // the way through a halo along its foot
    float met = high > 0.0 ? most * exp(-high / FALL_M)
        : min(FALL_M / sqrt(max(1.0 - inside * inside, 1e-4)), 0.5 * most);
    float tuft = 0.6 + 0.8 * uniform01(cell_word(floor(q / TUFT) + 0.5));
    if (1.0 - exp(-STRAY * v_strand.w * tuft * met) < limit) return 0.0;
    float way = outer * facing - (high > 0.0 ? 0.0 : HEAD_M * sqrt(max(1.0 - inside * inside, 0.0)));
    float along = (uniform01(cell_word(floor(q))) - 0.5) * 2.0 * sqrt(HEAD_M * FALL_M);
    return v_sheet_m.z + (high > 0.0 ? way + along : way - min(abs(along), 0.8 * way));
}

// Depth, m, and albedo of the strand at a sample of a sheet with an albedo; discards the sample in a gap.
// The albedo is negative, which says that fibres scatter the light: they are as bright from all sides.
vec2 strand_seen(float albedo) {
    vec3 across = normalize(cross(dFdx(v_sheet_m), dFdy(v_sheet_m)));
    float facing = abs(dot(across, normalize(v_sheet_m)));
    vec3 q = v_strand.xyz;
    // Strands are not straight: they swing by half of their width. Chosen.
    q.xy += 0.5 * sin(2.4 * q.z + 0.7 * q.yx);
    uint own = cell_word(floor(q)), together = cell_word(floor(q / TUFT) + 0.5);
    float dense = uniform01(together), lies = uniform01(together << 12u);
    // A ray that grazes the sheet meets more strands: the gaps that are left fall as in Beer's law.
    float gaps = max(1.0 - v_strand.w * (0.2 + 1.6 * dense), 0.0);
    float share = v_sink_m < 0.0 ? 0.0 : 0.6 * uniform01(own << 12u) + 1.8 * lies * lies;
    float deep = v_sheet_m.z + v_sink_m * share;
    if (v_sink_m < 0.0) deep = stray_hair(-v_sink_m, facing, q);
    if (deep <= 0.0 || v_sink_m >= 0.0 && uniform01(own) < pow(gaps, 1.0 / max(facing, 0.1))) discard;
    return vec2(deep, -albedo * exp(-v_sink_m * share / LOST_M));
}
#endif
