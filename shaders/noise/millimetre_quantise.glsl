#version 330 core
// millimetre_quantise: rounds the depth to multiples of a step.
// Default: 1 mm, the unit in which the Kinect V2 delivers.
//@ sparse
uniform float step_mm = 1.0;  //@ [0.001, 100] mm step of the depth

uniform sampler2D u_depth;

out float depth;

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_depth, 0));
    depth = textureLod(u_depth, here, 0.0).r;
    if (depth <= 0.0) return;
    float steps = max(floor(1000.0 * depth / step_mm + 0.5), 1.0);
    depth = 0.001 * step_mm * steps;
}
