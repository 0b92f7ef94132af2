#version 330 core
// correlation_window: matches the dots of the projected pattern in windows of 9x9 pixels.
// The rule of BlenSor and render_kinect: more than 2/3 of the window's dots must be seen, and more
// than 2/3 must agree with their mean disparity, farther dots less strictly.
// One pixel of the written layer is one 3x3 cell of the pattern, i.e. one dot: 0 without a match,
// otherwise 1 + the place of the dot in its cell.
#include "lib/dots.glsl"
#include "lib/layers.glsl"
#include "lib/disparity.glsl"

uniform float min_share = 0.6666667;  //@ [0, 1]   1  share of the window's dots that must be seen, and that must agree
uniform float inlier_px = 0.1;        //@ [0, 10]  px largest weighted deviation from the mean disparity that agrees

uniform sampler2D u_depth;

const int REACH_PX = 4;    // 9x9
const int REACH_CELLS = 2; // pixels within 4 px of a dot lie within two cells of its cell

out float dot_match; //@ 1/3 of the frame

void main() {
    ivec2 cell = ivec2(gl_FragCoord.xy);
    ivec2 centre = dot_pixel(cell);
    dot_match = 0.0;
    if (fetch(u_depth, centre) <= 0.0) return;
    float dots = 0.0, seen = 0.0, sum = 0.0;
    for (int y = -REACH_CELLS; y <= REACH_CELLS; y++) {
        for (int x = -REACH_CELLS; x <= REACH_CELLS; x++) {
            ivec2 pixel = dot_pixel(cell + ivec2(x, y));
            ivec2 offset = abs(pixel - centre);
            if (max(offset.x, offset.y) > REACH_PX) continue;
            float depth = fetch(u_depth, pixel);
            dots += 1.0;
            if (depth > 0.0) {
                seen += 1.0;
                sum += disparity_px(depth);
            }
        }
    }
    if (seen <= min_share * dots) return;
    float mean = sum / seen, agree = 0.0;
    for (int y = -REACH_CELLS; y <= REACH_CELLS; y++) {
        for (int x = -REACH_CELLS; x <= REACH_CELLS; x++) {
            ivec2 pixel = dot_pixel(cell + ivec2(x, y));
            ivec2 offset = abs(pixel - centre);
            float depth = fetch(u_depth, pixel);
            if (max(offset.x, offset.y) > REACH_PX || depth <= 0.0) continue;
            vec2 stretched = 1.2 * vec2(offset);
            float weight = offset == ivec2(0) ? 1.0 : 1.0 / dot(stretched, stretched);
            if (abs(disparity_px(depth) - mean) * weight < inlier_px) agree += 1.0;
        }
    }
    if (agree > min_share * dots) dot_match = 1.0 + float(dot_place(cell));
}
