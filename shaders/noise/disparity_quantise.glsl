#version 330 core
// disparity_quantise: rounds the disparity as a structured-light decoder does.
// Default: 1/8 px of the Kinect V1 (and of BlenSor and render_kinect).
#include "lib/disparity.glsl"

uniform float step_px = 0.125;  //@ [0.001, 4] px step of the disparity

uniform sampler2D u_depth;

out float depth;

void main() {
    depth = texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r;
    if (depth <= 0.0) return;
    float steps = max(floor(disparity_px(depth) / step_px + 0.5), 1.0);
    depth = disparity_px(steps * step_px); // the conversion is its own inverse
}
