#version 330 core
// millimetre_quantise: rounds the depth to whole steps.
// Default: 1 mm, the unit in which the Kinect V2 delivers.
//@ sparse
uniform float step_mm = 1.0;  //@ [0.001, 100] mm smallest difference of depth

uniform sampler2D u_depth;

out float depth;

void main() {
    depth = texelFetch(u_depth, ivec2(gl_FragCoord.xy), 0).r;
    if (depth <= 0.0) return;
    float steps = max(floor(1000.0 * depth / step_mm + 0.5), 1.0);
    depth = 0.001 * step_mm * steps;
}
