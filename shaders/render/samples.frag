#version 330 core
// samples: the surface on a grid finer than the pixels, in as few numbers as will do.
#include "lib/folds.glsl"
#include "lib/gloss.glsl"
#include "lib/strands.glsl"

in vec3 v_position_m;
in float v_albedo;
flat in float v_material;

out vec2 fine_seen; // depth, albedo; a strand's albedo is negative

void main() {
    fine_seen = vec2(v_position_m.z, glossy(v_albedo, v_material, v_position_m));
#ifdef FOLDS
    fine_seen = vec2(folded(v_position_m).z, v_albedo);
#endif
#ifdef STRANDS
    fine_seen = strand_seen(v_albedo);
#endif
}
