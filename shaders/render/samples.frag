#version 330 core
// samples: surface.frag for a grid finer than the pixels, in as few numbers as will do.
#include "lib/facet.glsl"

in vec3 v_position_m;
in float v_albedo;

out float fine_clean;
out vec4 fine_normal; // and in w the albedo

void main() {
    fine_clean = v_position_m.z;
    fine_normal = vec4(facet_normal(v_position_m), v_albedo);
}
