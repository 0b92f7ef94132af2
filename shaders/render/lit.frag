#version 330 core
// lit: shadow mapping: the share of a pixel that an emitter lights, from the emitter's z-buffer.
// One pass per emitter, summed up; u_weight is 1 / number of emitters, or in the component of the
// emitter's own for an imager, which keeps projectors apart. A spread emitter is three
// points, its centre and its ends; visibility from the ends is found by ray marching in the z-buffer
// of the centre, along the line from the surface to the end.
uniform sampler2D u_clean;
uniform sampler2D u_normal;
uniform sampler2D u_rays;
uniform sampler2DShadow u_projector; // linear filter: the share of 4 texels that are farther away
uniform sampler2D u_projector_depth; // the same z-buffer, unfiltered
uniform vec3 u_emitter_m;
uniform vec2 u_spread_m;   // from the centre of the emitter to its end; 0 for a point
uniform vec3 u_shares;     // of the light: the near end's, the centre's, the far end's
uniform vec4 u_map;        // tangents (x/z, y/z) to texture coordinates: scale.xy, offset.zw
uniform vec2 u_map_range;  // near and far plane of the z-buffer, m
uniform float u_texel;     // size of a texel of the z-buffer, tangent units
uniform vec2 u_weight;
uniform vec3 u_eye_m;      // where u_clean is seen from

// A surface that is flat over a texel differs by its slope times at most one texel from the depth
// at the texel's centre (bilinear: 1 in x and in y). Beyond a slope of ten it is grazing, and more
// bias would only detach shadows. The constant covers the facets of a face mesh and of its occluder, whose
// fewer triangles span concave places such as the root of the nose. Frames with a false shadow of 4 px or
// more there, of 120 of embedded heads and 40 of ICT-FaceKit: 13 % and 55 % with 0.3 mm, 1 % and 10 % with
// 1 mm, 0 and 5 % with 1.5 mm, which also differs least from the shadows of all triangles (0.0003 of lit).
const float CONSTANT_BIAS_M = 0.0015;
const float SLOPE_TEXELS = 1.0;
const float MAX_SLOPE = 10.0;
// The z-buffer holds front surfaces only. A line that passes behind one by more than this passes
// behind the object: half a head is 0.1 m. From one texel to the next a line may get deeper by more
// than that; a front that it crosses in between hides it too.
const float THICKNESS_M = 0.1;
const int MAX_WALK = 64; // texels: 15 mm of spread from 0.5 m to any distance are 16

out vec2 lit; // the second component only for imagers

// A depth seen from the emitter, m, to the value in the z-buffer; and that value to 1 / depth.
float to_stored(float z) {
    float n = u_map_range.x, f = u_map_range.y;
    return 0.5 + 0.5 * ((f + n) - 2.0 * f * n / z) / (f - n);
}

float inverse_of_stored(float stored) {
    float n = u_map_range.x, f = u_map_range.y;
    return mix(1.0 / n, 1.0 / f, stored);
}

// Whether the two ends of the emitter, ``spread`` metres along ``direction`` and against it, see the
// point at ``tangent``, ``z``. After s tangent units the line has depth 1 / (1 / z + s / spread).
vec2 reached(vec2 tangent, float z, float spread, vec2 direction, float bias) {
    float longest = spread * (1.0 / u_map_range.x - 1.0 / z);
    vec2 free = vec2(1.0), middle = tangent * u_map.xy + u_map.zw;
    vec2 texel = u_texel * direction * u_map.xy;
    float gain = u_texel / spread; // of inverse depth along the line, per texel
    for (int k = 0; k <= MAX_WALK && (float(k) - 0.5) * u_texel < longest && free.x + free.y > 0.0; k++) {
        float far = max(float(k) - 0.5, 0.0), line = 1.0 / z + far * gain;
        vec2 there = vec2(
            inverse_of_stored(textureLod(u_projector_depth, middle + far * texel, 0.0).r),
            inverse_of_stored(textureLod(u_projector_depth, middle - far * texel, 0.0).r));
        vec2 behind = there - line, scale = there * line; // m, times both inverse depths
        vec2 deepest = max(THICKNESS_M * scale, bias * scale + gain);
        free *= 1.0 - step(bias * scale, behind) * (1.0 - step(deepest, behind));
    }
    return free;
}

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_clean, 0));
    float depth = textureLod(u_clean, here, 0.0).r;
    lit = vec2(0.0);
    if (depth <= 0.0) return;
    vec3 position = vec3(textureLod(u_rays, here, 0.0).rg, 1.0) * depth + u_eye_m;
    vec3 normal = textureLod(u_normal, here, 0.0).xyz;
    vec3 seen = position - u_emitter_m; // from the emitter
    float facing = -dot(normal, seen) / seen.z;
    if (seen.z <= u_map_range.x || facing <= 0.0) return;
    float slope = min((abs(normal.x) + abs(normal.y)) / facing, MAX_SLOPE);
    float bias = CONSTANT_BIAS_M + SLOPE_TEXELS * slope * u_texel * seen.z;
    vec2 tangent = seen.xy / seen.z;
    float stored = clamp(to_stored(seen.z - bias), 0.0, 1.0);
    float share = texture(u_projector, vec3(tangent * u_map.xy + u_map.zw, stored));
    float spread = length(u_spread_m);
    if (spread > 0.0) {
        vec2 direction = u_spread_m / spread;
        vec2 ends = reached(tangent, seen.z, spread, direction, bias);
        share = dot(u_shares, vec3(ends.y, share, ends.x));
    }
    lit = u_weight * share;
}
