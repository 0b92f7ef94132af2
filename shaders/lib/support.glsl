// support: the disparity that a matching window finds along one axis of the image.
// A window that holds two surfaces finds the nearer one, whose dots move most: near surfaces grow over
// far ones. What it finds is a mean over the pixels of that surface.
#include "lib/lattice_noise.glsl"

uniform float support_px = 13.0;    //@ [1, 31]  px side of the window whose disparities are averaged, along both axes; real noise is alike over a box of 13 to 15 px
uniform float support_step_px = 1.0; //@ [0.1, 16] px difference in disparity that separates surfaces, as in match_stereo
uniform float rim_step_px = 3.0;     //@ [0.25, 64] px difference in disparity beside which a far surface is lost; smaller steps become slopes
uniform float rough_px = 1.5;       //@ [0, 8]   px standard deviation of the growth along a silhouette
uniform float rough_length_px = 6.0; //@ [1, 16]  px length of the bumps of a silhouette

uniform uint u_seed;
uniform vec3 u_second_view_m;

// The axis of the baseline, with the sign of the second view's side.
ivec2 along_baseline() {
    return abs(u_second_view_m.x) >= abs(u_second_view_m.y)
        ? ivec2(u_second_view_m.x < 0.0 ? -1 : 1, 0) : ivec2(0, u_second_view_m.y < 0.0 ? -1 : 1);
}

float disparity_at(ivec2 pixel); // px, 0 where there is no surface; each stage defines it

// The disparity of the window at a pixel, px, 0 = none. growth_px: of surfaces behind it and ahead of it
// along the axis.
float support_disparity(ivec2 pixel, ivec2 axis, vec2 growth_px) {
    float front = disparity_at(pixel), total = front, count = front > 0.0 ? 1.0 : 0.0;
    int reach = int(support_px) / 2, k = 0;
    while (++k <= 2 * reach) {
        int away = (k + 1) / 2;
        bool behind = (k & 1) == 1;
        float there = disparity_at(pixel + (behind ? -away : away) * axis);
        bool nearer = there > front + support_step_px && float(away) <= (behind ? growth_px.x : growth_px.y);
        bool alike = there > 0.0 && abs(there - front) < support_step_px;
        total = nearer ? there : total + (alike ? there : 0.0);
        count = nearer ? 1.0 : count + (alike ? 1.0 : 0.0);
        front = nearer ? there : front;
    }
    return total / max(count, 1.0);
}
