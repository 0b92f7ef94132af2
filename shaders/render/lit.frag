#version 330 core
// lit: shadow mapping. Which share of a pixel the emitter reaches, from its z-buffer.
// One pass an emitter, added up; u_weight is 1 / number of emitters.
uniform sampler2D u_clean;
uniform sampler2D u_normal;
uniform sampler2D u_rays;
uniform sampler2DShadow u_projector; // linear filter: the share of 4 texels that are farther
uniform vec3 u_emitter_m;
uniform vec4 u_map;        // tangents (x/z, y/z) to texture coordinates: scale.xy, offset.zw
uniform vec2 u_map_range;  // near and far plane of the z-buffer, m
uniform float u_texel;     // tangent units a texel of the z-buffer covers
uniform float u_weight;

// A surface that is flat over a texel differs by its slope times at most one texel from the depth
// at the texel's centre (bilinear: 1 in x and in y); beyond ten texels' worth it is grazing, and
// more bias would only detach shadows. The constant covers the facets of a mesh of a face.
const float CONSTANT_BIAS_M = 0.0003;
const float SLOPE_TEXELS = 1.0;
const float MAX_SLOPE = 10.0;

out float lit;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float depth = texelFetch(u_clean, pixel, 0).r;
    lit = 0.0;
    if (depth <= 0.0) return;
    vec3 position = vec3(texelFetch(u_rays, pixel, 0).rg, 1.0) * depth;
    vec3 normal = texelFetch(u_normal, pixel, 0).xyz;
    vec3 seen = position - u_emitter_m; // from the emitter
    float facing = -dot(normal, seen) / seen.z;
    if (seen.z <= u_map_range.x || facing <= 0.0) return;
    float slope = min((abs(normal.x) + abs(normal.y)) / facing, MAX_SLOPE);
    float bias = CONSTANT_BIAS_M + SLOPE_TEXELS * slope * u_texel * seen.z;
    float n = u_map_range.x, f = u_map_range.y;
    float z = seen.z - bias;
    float stored = 0.5 + 0.5 * ((f + n) - 2.0 * f * n / z) / (f - n);
    vec2 at = seen.xy / seen.z * u_map.xy + u_map.zw;
    lit = u_weight * texture(u_projector, vec3(at, clamp(stored, 0.0, 1.0)));
}
