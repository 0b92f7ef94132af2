#version 330 core
// pattern_light: draws the light that the imager of a structured-light camera gets, and its pattern.
// The image is matched with the pattern: the dots as an imager at the projector would see them, at any
// distance.
#include "lib/projected_dots.glsl"

uniform sampler2D u_left_clean;
uniform sampler2D u_left_normal;
uniform sampler2D u_left_lit;
uniform sampler2D u_rays;
uniform vec3 u_imager_1_m;

out float light_left;
out float light_right;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 ray = vec3(texelFetch(u_rays, pixel, 0).rg, 1.0);
    float left = texelFetch(u_left_clean, pixel, 0).r;
    light_left = imaged_light(left, texelFetch(u_left_normal, pixel, 0),
        texelFetch(u_left_lit, pixel, 0).rg, left * ray + u_imager_1_m);
    light_right = max(thrown(ray.xy, pcg_word(u_device_seed)), 0.0);
}
