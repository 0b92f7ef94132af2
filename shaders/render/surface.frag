#version 330 core
// surface: the clean layers. Depth is the interpolated camera-space z, not the depth buffer's.
#include "lib/facet.glsl"

in vec3 v_position_m;
in float v_albedo;

out float clean;
out vec4 normal; // and in w the albedo, for stages that want both at once
out float albedo;

void main() {
    clean = v_position_m.z;
    normal = vec4(facet_normal(v_position_m), v_albedo);
    albedo = v_albedo;
}
