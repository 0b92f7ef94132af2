#version 330 core
// range_gate: removes depth outside the measuring range.
// Default: the range of libfreenect2, and Microsoft's reliable range of the Kinect V2.
//@ sparse
#include "reason.glsl"

uniform float near_mm = 500.0;  //@ [0, 20000] mm nearest depth that is kept
uniform float far_mm = 4500.0;  //@ [0, 65535] mm farthest depth that is kept

uniform sampler2D u_depth;
uniform sampler2D u_reason;

out float depth;
out float reason;

void main() {
    vec2 here = gl_FragCoord.xy / vec2(textureSize(u_depth, 0));
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    depth = textureLod(u_depth, here, 0.0).r;
    reason = textureLod(u_reason, here, 0.0).r;
    float depth_mm = 1000.0 * depth;
    if (depth > 0.0 && (depth_mm < near_mm || depth_mm > far_mm)) {
        depth = 0.0;
        reason = REASON_OUT_OF_RANGE;
    }
}
