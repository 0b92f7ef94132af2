#version 330 core
// surface: writes the clean layers. Depth is the interpolated camera-space z, not the depth buffer.
#include "lib/facet.glsl"

in vec3 v_position_m;
in float v_albedo;

out float clean;
out vec4 normal; // w: albedo, for stages that read both
out float albedo;

void main() {
    clean = v_position_m.z;
    normal = vec4(facet_normal(v_position_m), v_albedo);
    albedo = v_albedo;
}
