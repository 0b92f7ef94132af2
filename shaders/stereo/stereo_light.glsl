#version 330 core
// stereo_light: draws the light that two imagers get, with the dots of up to two projectors.
#include "lib/projected_dots.glsl"

uniform sampler2D u_left_clean;
uniform sampler2D u_left_normal;
uniform sampler2D u_left_lit;
uniform sampler2D u_right_clean;
uniform sampler2D u_right_normal;
uniform sampler2D u_right_lit;
uniform sampler2D u_rays;
uniform vec3 u_imager_1_m;
uniform vec3 u_imager_2_m;

out float light_left;
out float light_right;

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec3 ray = vec3(texelFetch(u_rays, pixel, 0).rg, 1.0);
    float left = texelFetch(u_left_clean, pixel, 0).r, right = texelFetch(u_right_clean, pixel, 0).r;
    light_left = imaged_light(left, texelFetch(u_left_normal, pixel, 0),
        texelFetch(u_left_lit, pixel, 0).rg, left * ray + u_imager_1_m);
    light_right = imaged_light(right, texelFetch(u_right_normal, pixel, 0),
        texelFetch(u_right_lit, pixel, 0).rg, right * ray + u_imager_2_m);
}
