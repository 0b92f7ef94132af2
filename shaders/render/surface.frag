#version 330 core
// surface: writes the clean layers. Depth is the interpolated camera-space z, not the depth buffer.
#include "lib/folds.glsl"
#include "lib/gloss.glsl"
#include "lib/strands.glsl"

in vec3 v_position_m;
in float v_albedo;
flat in float v_material;

out float clean;
out vec4 normal; // w: albedo, for stages that read both
out float albedo;

void main() {
    clean = v_position_m.z;
    albedo = glossy(v_albedo, v_material, v_position_m);
    normal = vec4(facet_normal(v_position_m), albedo);
#ifdef FOLDS
    vec3 fold = folded(v_position_m);
    clean = fold.z;
    normal = vec4(facet_normal(fold), albedo);
#endif
#ifdef STRANDS
    vec2 strand = strand_seen(v_albedo);
    clean = strand.x;
    albedo = -strand.y;
    normal = vec4(-normalize(v_position_m), albedo);
#endif
}
