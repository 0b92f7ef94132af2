#version 330 core
// surface: transforms a mesh into the camera's view, with its position for the layers.
#include "lib/strand_sheets.glsl"

uniform mat4 u_view; // canonical mm -> camera m
uniform mat4 u_clip;

in vec3 in_position_mm;
in float in_albedo;

#ifdef FOLDS
in vec4 in_fold;
in vec4 in_crease;
out vec4 v_fold;
out vec4 v_crease;
#endif

out vec3 v_position_m;
out float v_albedo;
flat out float v_material; // number of a glossy material, of the triangle's last corner; 0: matte

void main() {
    vec4 position = u_view * vec4(in_position_mm, 1.0);
    pass_strands(position);
#ifdef FOLDS
    v_fold = in_fold;
    v_crease = in_crease;
#endif
    v_position_m = position.xyz;
    v_material = floor(0.25 * in_albedo); // as WORN_GLOSS in glsim/looks/dress.py adds it
    v_albedo = in_albedo - 4.0 * v_material;
    gl_Position = u_clip * position;
}
