#version 330 core
// single_view_match: finds the disparities of a stereo camera from the depth of its first view.
// A statistical model of match_stereo, without the second image. What the second view cannot see is
// found by a march along the baseline: a surface k pixels on its side hides a point if its disparity is
// larger by more than k. First stage of its chain; single_view_noise follows.
#include "lib/support.glsl"
#include "lib/layers.glsl"
#include "reason.glsl"

uniform float growth_px = 4.0;   //@ [-8, 8]  px how far near surfaces grow over far ones, along the baseline
uniform float growth_in_shadow_px = 1.0; //@ [-8, 8] px and on the side that the second view does not see
uniform float shadow_px = 5.0;   //@ [0, 31]  px by this less rim_step_px the shadow of the second view is wider than geometry says; real ones are 1.03 to 1.13 times as wide
uniform float border_px = 9.0;   //@ [0, 64]  px lost beside the part of the image that the second view does not see, besides
uniform float largest_px = 126.0; //@ [1, 1024] px largest disparity that is searched: nearest = f B / it

uniform sampler2D u_clean;
uniform float u_focal_baseline_px_m;
uniform float u_nearest_m; // smallest depth of the scene: nothing nearer casts a shadow

out float disparity;
out float fate; // why a pixel will be lost, a reason code

float disparity_at(ivec2 pixel) {
    float z = fetch(u_clean, pixel);
    return z > 0.0 ? u_focal_baseline_px_m / z : 0.0;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy), axis = along_baseline(), size = textureSize(u_clean, 0);
    float bumps = lattice_noise(pixel, vec2(rough_length_px), u_seed);
    disparity = support_disparity(pixel, axis, vec2(growth_px, growth_in_shadow_px) + rough_px * bumps);
    float nearest = min(largest_px, u_focal_baseline_px_m / max(u_nearest_m, 1e-3));
    float own = disparity + rim_step_px;
    int last = disparity > 0.0 ? int(nearest - own) : 0, wider = int(shadow_px), k = 0;
    bool hidden = false;
    do {
        hidden = hidden || disparity_at(pixel + (wider + k) * axis) - float(k) > own;
    } while (!hidden && ++k <= last);
    int place = axis.x + axis.y > 0 ? pixel.x * axis.x + pixel.y * axis.y
        : (size.x - 1 - pixel.x) * -axis.x + (size.y - 1 - pixel.y) * -axis.y;
    hidden = hidden || float(place) < disparity + border_px;
    fate = hidden ? REASON_SHADOW : REASON_VALID;
    if (disparity > largest_px) fate = REASON_OUT_OF_RANGE;
    if (disparity <= 0.0) fate = REASON_NO_SURFACE;
}
